#include "monitor_session.hpp"

#include <algorithm>
#include <cmath>

namespace servosense::cli {
void Envelope::add(double t_s, double value) {
  if (!std::isfinite(value)) return;
  if (buckets_.empty() || buckets_.back().count == per_bucket_) {
    if (buckets_.size() == kMostBuckets) {
      for (std::size_t i = 0; i < kMostBuckets / 2; ++i) {
        const Bucket& a = buckets_[2 * i];
        const Bucket& b = buckets_[2 * i + 1];
        Bucket joined = a;
        if (b.low < a.low) {
          joined.low = b.low;
          joined.t_low = b.t_low;
        }
        if (b.high > a.high) {
          joined.high = b.high;
          joined.t_high = b.t_high;
        }
        joined.count = a.count + b.count;
        joined.sum = a.sum + b.sum;
        buckets_[i] = joined;
      }
      buckets_.resize(kMostBuckets / 2);
      per_bucket_ *= 2;
    }
    buckets_.push_back({t_s, value, t_s, value, 0, 0});
  }
  Bucket& b = buckets_.back();
  if (value < b.low) {
    b.low = value;
    b.t_low = t_s;
  }
  if (value > b.high) {
    b.high = value;
    b.t_high = t_s;
  }
  ++b.count;
  b.sum += value;
}

double Envelope::largest_magnitude() const {
  double largest = 0;
  for (const Bucket& b : buckets_) largest = std::max({largest, std::abs(b.low), std::abs(b.high)});
  return largest;
}

void Envelope::points(std::vector<double>& x, std::vector<double>& y) const {
  for (const Bucket& b : buckets_) {
    const bool low_first = b.t_low <= b.t_high;
    x.push_back(low_first ? b.t_low : b.t_high);
    y.push_back(low_first ? b.low : b.high);
    if (b.t_low == b.t_high) continue;
    x.push_back(low_first ? b.t_high : b.t_low);
    y.push_back(low_first ? b.high : b.low);
  }
}

void Envelope::means(std::size_t most, std::vector<double>& x, std::vector<double>& y) const {
  const std::size_t joined = std::max<std::size_t>(1, (buckets_.size() + most - 1) / most);
  for (std::size_t i = 0; i < buckets_.size(); i += joined) {
    const std::size_t end = std::min(i + joined, buckets_.size());
    double sum = 0, count = 0;
    for (std::size_t k = i; k < end; ++k) {
      sum += buckets_[k].sum;
      count += static_cast<double>(buckets_[k].count);
    }
    const auto middle = [](const Bucket& b) { return 0.5 * (b.t_low + b.t_high); };
    x.push_back(0.5 * (middle(buckets_[i]) + middle(buckets_[end - 1])));
    y.push_back(sum / count);
  }
}

std::vector<ToolHistory> tool_histories(const StackPlan& plan) {
  std::vector<ToolHistory> all;
  const ToolMonitorsConfig& tool = plan.config.tool;
  const auto add = [&](bool on, MonitorId id, const char* title, const char* caption,
                       const char* y_label, const char* unit) {
    if (on) all.push_back({id, title, caption, y_label, unit, 0, {}});
  };
  add(tool.tooth_breakage_on, MonitorId::tooth_breakage, "Tooth breakage",
      "Part of a tooth's load that was there a turn ago and is missing now.", "share of a tooth",
      "");
  add(tool.ar_breakage_on, MonitorId::ar_breakage, "AR breakage",
      "Part of a tooth's load that has moved to its neighbour.", "share of a tooth", "");
  add(tool.drill_fracture_on, MonitorId::drill_fracture, "Drill fracture",
      "Lateral force that turns with the drill.", "force", "N");
  const bool thrust =
      tool.wear.thrust_limit_N > 0 || tool.wear.thrust_step_N > 0 || tool.wear.thrust_ratio > 0;
  add(tool.wear_on, MonitorId::wear, "Wear", "Level of the last holes, as compared by the rule.",
      thrust ? "thrust" : "torque", "");
  add(tool.torque_band_on, MonitorId::torque_band, "Torque band",
      "Steps of the program whose torque no timing within the tolerance explains.", "steps outside",
      "");
  return all;
}

void keep(ToolHistory& history, const HostStack& stack, double t_s) {
  const auto take = [&](double value, double threshold) {
    history.value.add(t_s, value);
    if (threshold > 0) history.threshold = threshold;
  };
  const auto& tool = stack.tool();
  switch (history.monitor) {
    case MonitorId::tooth_breakage:
      return take(tool.tooth_breakage().core().state().value,
                  tool.tooth_breakage().core().alarm().threshold());
    case MonitorId::ar_breakage:
      return take(tool.ar_breakage().core().state().value,
                  tool.ar_breakage().core().alarm().threshold());
    case MonitorId::drill_fracture:
      return take(tool.drill_fracture().state().value_N, tool.drill_fracture().alarm().threshold());
    case MonitorId::wear:
      return take(tool.wear().tool().value, tool.wear().tool().threshold);
    default:
      return take(tool.torque_band().core().value, tool.torque_band().alarm().threshold());
  }
}

void keep(BandHistory& history, const HostStack& stack, double t_s) {
  const auto& band = stack.tool().torque_band();
  if (band.state().steps == history.steps) return;
  history.steps = band.state().steps;
  const auto& core = band.core();
  history.measured.add(t_s, core.measured_Nm);
  history.expected.add(t_s, core.expected_Nm);
  history.lower.add(t_s, core.lower_Nm);
  history.upper.add(t_s, core.upper_Nm);
}

ToolHistory reference_history() {
  return {MonitorId::reference,
          "Sound reference",
          "How far the cut is from the sound ones; the middle of three windows.",
          "distance",
          "",
          0,
          {}};
}

void keep(ToolHistory& history, const MonitorRun& run) {
  history.threshold = run.reference_threshold;
  for (const ReferenceVerdict& v : *run.reference)
    if (v.distance) history.value.add((v.from_s + v.to_s) / 2, *v.distance);
}

}  // namespace servosense::cli
