#include "pair_watches.hpp"

#include <cmath>
#include <utility>

namespace servosense::cli {

Expected<std::unique_ptr<RowSource>> PairWatches::tap(std::unique_ptr<RowSource> rows) {
  readers_ = pair_readers(machine_, rows->signals());
  fastest_feed_.assign(readers_.size(), 0);
  for (std::size_t i = 0; i < readers_.size(); ++i) {
    auto planned = plan_pairs(machine_, readers_[i].columns());
    if (!planned) return planned.error();
    for (PlannedPair& p : *planned) {
      const PairWatchConfig config = p.config;
      pairs_.push_back({readers_[i].columns().channel, std::move(p), PairWatch(config), i});
    }
  }
  if (readers_.empty()) return rows;
  return std::unique_ptr<RowSource>(
      std::make_unique<PairRows>(std::move(rows), readers_, [this](std::size_t i) { heard(i); }));
}

void PairWatches::hear(const MachineStack& stack, const StackPlan& plan) {
  const CutDetectorConfig& cut = plan.config.cut;
  seen_cut_ = plan.config.spindle.present && cut.torque_Nm > 0;
  air_ = seen_cut_ && stack.first().cut().state().cut == CutPresence::air;
  for (std::size_t i = 0; i < readers_.size(); ++i)
    if (const Channel channel = readers_[i].columns().channel; is_axis(channel))
      fastest_feed_[i] = plan.config.axis[axis_index(channel)].collision.maximum_feed_m_s;
}

void PairWatches::heard(std::size_t reader) {
  const PairSample& sample = readers_[reader].sample();
  const bool rapid = fastest_feed_[reader] > 0 && std::abs(sample.velocity) > fastest_feed_[reader];
  for (Pair& pair : pairs_) {
    if (pair.reader != reader || !pair.plan.runs) continue;
    const PairWatch::Change change = pair.watch.process(sample, air_ || rapid);
    if (change == PairWatch::Change::none) continue;
    const bool beyond = change == PairWatch::Change::beyond;
    const PairKind kind = pair.plan.kind;
    const bool pushes = kind == PairKind::following && pair.watch.saturated();
    const bool racks = kind == PairKind::skew || kind == PairKind::skew_effort;
    if (beyond) pair.raised = pushes ? MonitorId::collision : MonitorId::signal;
    Event event;
    event.t_s = sample.t_s;
    event.monitor = pair.raised;
    event.channel = std::string(name_of(pair.channel));
    event.state = !beyond           ? MonitorState::armed
                  : pushes || racks ? MonitorState::alarm
                                    : MonitorState::warning;
    event.value = pair.watch.value();
    event.threshold = pair.watch.allowed();
    event.unit = pair_unit(kind, pair.channel);
    event.reason = pair_text(pair.watch, pair.channel, beyond);
    waiting_.push_back(std::move(event));
  }
}

std::vector<Event> PairWatches::events(double t_s) {
  std::vector<Event> due;
  while (!waiting_.empty() && waiting_.front().t_s <= t_s) {
    due.push_back(std::move(waiting_.front()));
    waiting_.pop_front();
  }
  return due;
}

}  // namespace servosense::cli
