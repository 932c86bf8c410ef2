// Two efforts of one drive: a current, and a torque or a force beside it; of a spindle a power or a
// load, too, which its speed makes a torque of.
//
// Where the machine file knows the noise of both (effort_noise_*, written by `identify idle`), the
// row's current becomes their mean, weighted with 1 / noise^2, where both have a new value. They
// are held against each other all the time: means over 50 ms, the one over the other by least
// squares that forgets in half a minute. A ratio that is off by more than 5 %, the error of a
// torque constant, and four standard errors is told once, by name, and from then on the current is
// taken alone. What is lost of a power is told by an idling run; slower than power tells the torque
// the current is alone. Beyond base speed a current is no torque: a drive whose constant falls with
// speed is left out, and that is said.
#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "beside_power.hpp"
#include "servosense/core/channel.hpp"
#include "servosense/hal/row_source.hpp"
#include "servosense/identify/losses_by_current.hpp"
#include "servosense/io/event.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/monitors/monitor_stack.hpp"

namespace servosense::cli {

class EffortPairs {
 public:
  /// `mean` false: they are heard and left as they are.
  EffortPairs(const MachineFile& machine, const std::vector<Signal>& signals, bool mean);

  /// Rows that pass through are heard, and their currents made means.
  static std::unique_ptr<RowSource> tap(std::unique_ptr<RowSource> rows,
                                        std::shared_ptr<EffortPairs> pairs);
  void hear(TraceRow& row);

  struct Ratio {
    double value = 1, standard_error = 0;
    bool off = false;
  };
  struct Change {
    StateChange<double> change;
    Event event;
  };
  /// Pairs that have been found off since the last call.
  [[nodiscard]] std::vector<Change> changes(double t_s);
  /// Which columns are means, and with which weights; which are not compared, and why.
  [[nodiscard]] std::vector<std::string> remarks() const;
  /// Columns that are used beside the drives' own.
  [[nodiscard]] std::vector<std::size_t> used() const;
  /// After an idling run: the noise of the pairs that agree goes into the machine file. What is
  /// said of them.
  [[nodiscard]] std::vector<std::string> learn(MachineFile& machine);

 private:
  struct Pair {
    Channel channel = Channel::spindle;
    std::size_t current = 0, other = 0;  // columns
    std::string current_name, other_name;
    std::string noise_key;                // of the other
    std::optional<BesidePower> power;     // a power or a load: `other` is its column
    bool lost_unknown = false;            // what is lost of the power is not in the machine file
    LossesByCurrent losses;               // while learning
    double per_ampere = 1;                // of the other, by the machine file
    double noise_A = 0, noise_other = 0;  // 0: not known
    bool weakened = false;
    bool off = false, told = false;
    // Of the block, and of the blocks.
    double from_s = 0, n = 0, sum_current = 0, sum_other = 0;
    double blocks = 0, x = 0, y = 0, xx = 0, xy = 0, yy = 0;
    std::vector<double> last_current, last_other, bends_current, bends_other;
    [[nodiscard]] bool is_mean(bool mean) const {
      return mean && !off && !weakened && !lost_unknown && noise_A > 0 && noise_other > 0;
    }
    [[nodiscard]] double weight_of_other(double noise) const;
    [[nodiscard]] std::optional<Ratio> ratio() const;
    void end_block();
  };
  [[nodiscard]] static std::string said(const Pair& pair, const Ratio& ratio);
  static std::string learn(Pair& pair, MachineFile& machine);
  bool mean_;
  std::vector<Pair> pairs_;
};

}  // namespace servosense::cli
