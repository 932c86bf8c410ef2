// Learned machines at several rates, and what their monitors make of rows.
#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "faults/base_record.hpp"

namespace faults {

inline const std::vector<Reporting> kReporting = {{1, 1, false}, {1, 4, false}, {1, 4, true},
                                                  {2, 1, false}, {2, 4, true},  {4, 1, false},
                                                  {4, 4, false}, {8, 1, false}};

/// Machines as they have learned, one each of kReporting; every seed is another machine's noise.
class Machines {
 public:
  explicit Machines(unsigned seed) {
    const Plant idle(idle_course(), 100 * seed), sound(sound_course(), 100 * seed + 1);
    for (const Reporting& r : kReporting)
      machines_.push_back(learned(r, rows_of(idle, r), rows_of(sound, r)));
  }
  [[nodiscard]] const MachineFile& operator[](std::size_t i) const { return machines_[i]; }

 private:
  std::vector<MachineFile> machines_;
};

using Change = StateChange<double>;

[[nodiscard]] inline bool is_alarm(const Change& c) {
  return c.monitor != MonitorId::signal && c.state == MonitorState::alarm;
}
/// A fault is told.
[[nodiscard]] inline bool is_sick(MonitorState s) {
  return s == MonitorState::warning || s == MonitorState::signal_fault;
}
[[nodiscard]] inline std::string text_of(const Change& c, double t) {
  char text[160];
  std::snprintf(text, sizeof text, "%s on %s at %.4f s, %.3g of %.3g",
                servosense::name_of(c.monitor), std::string(servosense::name_of(c.channel)).c_str(),
                t, c.value, c.threshold);
  return text;
}

/// Feeds rows from `start` on to the stack, as `servosense monitor` does. `hear(row, sample,
/// changes)` after each sample; `row`: of the record, that was read last. The error that ends it,
/// or nothing.
template <typename Hear>
[[nodiscard]] std::string listen(const Rows& rows, std::size_t start, const MachineFile& machine,
                                 HostStack& stack, Hear&& hear) {
  auto list = std::make_unique<RowList>(rows, start);
  const RowList& sender = *list;
  auto source =
      SampleSource::open(std::move(list), "rows", SampleSource::kMaxFill, column_choices(machine));
  if (!source) return source.error().sentence;
  ServoSample<double> sample;
  for (;;) {
    auto more = source->next(sample);
    if (!more) return more.error().sentence;
    if (!*more) return {};
    hear(sender.taken(), sample, stack.process(sample));
  }
}

}  // namespace faults
