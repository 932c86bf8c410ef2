// Torque and force of the steps of a program, for the commands that predict them.
#pragma once

#include <cstddef>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "arguments.hpp"
#include "program_moves.hpp"
#include "servosense/io/json.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/process/torque/step_load.hpp"

namespace servosense::cli {

/// Of --machine, with the coefficient file that it names.
Expected<MachineFile> machine_with_coefficients(const Arguments& arguments);

/// A tool of which torque is not known, and which keys it takes.
struct UnknownTorque {
  int tool = 0;
  std::string lacks;
};

class ProgramLoads {
 public:
  /// `machine` outlives the loads.
  ProgramLoads(const MachineFile& machine, double stock_tolerance_m)
      : laws_(machine),
        compliance_(process::static_compliance(machine)),
        stock_tolerance_m_(stock_tolerance_m) {}
  /// Reads what the tools need.
  Expected<Done> look_up(const std::vector<int>& tools);

  [[nodiscard]] process::StepConditions conditions(const process::Engagement& e,
                                                   const MoveTechnology& t) const;
  [[nodiscard]] process::StepLoad of(const process::Engagement& e,
                                     const process::StepConditions& conditions) const;
  /// The same torque, without the rest: cheap, and as if no tooth ran out.
  [[nodiscard]] double mean_torque_Nm(const process::Engagement& e, const MoveTechnology& t) const;
  /// Of a tool that was looked up.
  [[nodiscard]] const process::ToolLaw& law(int tool) const { return *known_.at(tool); }
  [[nodiscard]] bool knows(int tool) const { return known_.contains(tool); }
  [[nodiscard]] const std::array<double, 2>& compliance() const { return compliance_; }
  [[nodiscard]] std::vector<UnknownTorque> lacks() const;
  /// What is not predicted, and how well the rest is known.
  [[nodiscard]] std::vector<std::string> remarks(const MachineFile& machine) const;

 private:
  process::ToolLaws laws_;
  std::array<double, 2> compliance_;
  double stock_tolerance_m_;
  std::map<int, const process::ToolLaw*> known_;
};

/// The greatest of a program, and where.
struct LoadSummary {
  struct Greatest {
    double value = 0;
    std::size_t line = 0;
    void add(double candidate, std::size_t at) {
      if (candidate > value) value = candidate, line = at;
    }
  };
  Greatest torque, peak, power, deflection;
  std::size_t predicted = 0, unknown = 0;  ///< steps that cut
  std::vector<UnknownTorque> lacks;

  void add(const process::Engagement& e, const process::StepLoad& load);
  void say_greatest() const;
  void write(JsonWriter& json) const;
};

}  // namespace servosense::cli
