// What torque and force a tool of a machine file asks for: its torque equation or its cutting
// coefficients, and how well they are known.
#pragma once

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/model/milling.hpp"
#include "servosense/process/tool/machine_tools.hpp"
#include "servosense/process/torque/torque_equation.hpp"

namespace servosense::process {

struct ToolLaw {
  CutterKind kind = CutterKind::flat;
  double radius_m = 0;
  int teeth = 0;
  double helix_deg = 0;
  std::vector<double> throw_m;  ///< of each tooth; empty: none
  /// Nothing: torque cannot be predicted, `lacks` says what to give.
  std::optional<TorqueEquation> torque;
  std::string lacks;
  bool from_equation = false;  ///< of `torque`, else from coefficients
  /// Relative standard error of the torque; nothing: not known.
  std::optional<double> relative_error;
  /// Where tangential and radial coefficients are known; else forces are not.
  std::optional<CuttingForceLaw> force;
};

class ToolLaws {
 public:
  /// `file` outlives the laws; [tool] has its coefficient file joined (`with_coefficients`).
  explicit ToolLaws(const MachineFile& file) : file_(&file) {}
  /// Data error for a list of throws that is not one a tooth.
  Expected<const ToolLaw*> of(int number);

 private:
  const MachineFile* file_;
  std::map<int, std::unique_ptr<ToolLaw>> known_;
};

}  // namespace servosense::process
