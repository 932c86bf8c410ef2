// What the cutting coefficients monitor has found, for summary, JSON, report and coefficient file.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "servosense/io/json.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/monitors/machine_stack.hpp"

namespace servosense::cli {

struct FoundCoefficient {
  std::string name, unit;
  double value = 0, standard_error = 0;
  bool told = false;  ///< the cuts of the record have told it
  std::string why;    ///< it is not told
};

/// In the order of the page; empty where the monitor does not run.
[[nodiscard]] std::vector<FoundCoefficient> found_coefficients(const MachineStack& stack);
void print(const std::vector<FoundCoefficient>& found);
void write(JsonWriter& json, const FoundCoefficient& found);

/// Those of found_coefficients() by their place there.
enum FoundPlace : std::size_t {
  kSpecificForce,
  kForceRatio,
  kTangential,
  kTangentialEdge,
  kRadial,
  kRadialEdge,
  kRadialRatio,
  kFoundCoefficients
};

/// The coefficients over the run, a point per group of revolutions, in bounded memory.
struct CoefficientHistory {
  struct Point {
    double t_s = 0;
    std::array<CuttingEstimate<double>, kFoundCoefficients> estimate{};
  };
  struct Change {
    double t_s = 0, share = 0;  ///< of the specific cutting force
  };
  std::vector<Point> points;
  std::vector<Change> changes;  ///< at most kMostChanges; found_changes has all
  std::uint64_t found_changes = 0;
  std::uint64_t slots = 0;                        ///< heard
  std::uint64_t every = 1;                        ///< slots a point
  double taught_N_per_m2 = 0, worn_N_per_m2 = 0;  ///< 0: none

  static constexpr std::size_t kMostPoints = 2000, kMostChanges = 1000;
};
void keep(CoefficientHistory& history, const MachineStack& stack, double t_s);

/// `monitor --coefficients-out`: a coefficient file of what the cuts have told. Where one feed has
/// told the specific force alone, K_tc and K_te are written as they hold together at that feed,
/// which is said in `remarks`; what is not told stays as `machine` has it. Data error where the
/// specific force is not told: nothing is written.
Expected<Done> write_found_coefficients(const std::string& path, const MachineFile& machine,
                                        const std::vector<FoundCoefficient>& found,
                                        const std::string& trace, std::uint64_t revolutions,
                                        std::vector<std::string>& remarks);

}  // namespace servosense::cli
