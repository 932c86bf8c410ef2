#include "effort_pairs.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <utility>

#include "idle_found.hpp"
#include "servosense/core/units.hpp"
#include "servosense/hal/wrapped_rows.hpp"
#include "servosense/io/text.hpp"
#include "servosense/observer/machine_config.hpp"

namespace servosense::cli {
namespace {

// Conventions.
constexpr double kBlock_s = 0.05;
constexpr double kForgets_s = 30;
constexpr double kFewestBlocks = 40;
constexpr double kConstantWithin = 0.05;  // as of torque_constant_known_to_rpm
constexpr double kEvidenceOff = 4;        // standard errors
constexpr double kNeighbours = 2;         // blocks after one another err alike
constexpr const char* kNoiseOfTorque = "effort_noise_Nm";
constexpr const char* kNoiseOfPower = "effort_noise_W";
constexpr std::size_t kMostBends = 400000;

class HeardRows final : public WrappedRows {
 public:
  HeardRows(std::unique_ptr<RowSource> rows, std::shared_ptr<EffortPairs> pairs)
      : WrappedRows(std::move(rows)), pairs_(std::move(pairs)) {}
  Expected<bool> next(TraceRow& row) override {
    auto more = rows_->next(row);
    if (more && *more && !row.fields.empty()) pairs_->hear(row);
    return more;
  }

 private:
  std::shared_ptr<EffortPairs> pairs_;
};

std::optional<std::size_t> column(const std::vector<Signal>& signals, Channel channel, Quantity q) {
  const auto at = std::ranges::find(signals, Signal{channel, q});
  if (at == signals.end()) return {};
  return static_cast<std::size_t>(at - signals.begin());
}

/// White noise bends a row of three values by the root of six times its sigma.
void bend(std::vector<double>& last, double value, std::vector<double>& bends) {
  last.push_back(value);
  if (last.size() < 3) return;
  if (bends.size() < kMostBends) bends.push_back(std::abs(last[0] - 2 * last[1] + last[2]));
  last.erase(last.begin());
}

/// 0 where there are too few.
double noise_of(std::vector<double> bends) {
  constexpr double kOfMedianSize = 1.4826;  // to a standard deviation, normal
  if (bends.size() < 100) return 0;
  const auto middle = bends.begin() + static_cast<std::ptrdiff_t>(bends.size() / 2);
  std::nth_element(bends.begin(), middle, bends.end());
  if (*middle > 0) return kOfMedianSize * *middle / std::sqrt(6.0);
  double square = 0;
  for (const double b : bends) square += b * b / static_cast<double>(bends.size());
  return std::sqrt(square / 6);
}

bool is_off(double ratio, double standard_error) {
  return std::abs(ratio - 1) > std::max(kConstantWithin, kEvidenceOff * standard_error);
}

}  // namespace

EffortPairs::EffortPairs(const MachineFile& machine, const std::vector<Signal>& signals, bool mean)
    : mean_(mean) {
  const ColumnChoices choices = column_choices(machine);
  for (const Channel channel : kDriveChannels) {
    const std::string section(section_of(channel));
    if (machine.has(section, "effort_column") || machine.flag(section, "gantry").value_or(false) ||
        machine.flag(section, "current_is_ratio").value_or(false) ||
        machine.flag(section, "current_is_unsigned").value_or(false))
      continue;
    const auto current = column(signals, channel, Quantity::current_A);
    auto other = column(signals, channel, Quantity::torque_Nm);
    const bool torque = other.has_value();
    if (!other && !is_turning(channel)) other = column(signals, channel, Quantity::force_N);
    ColumnChoice choice = choices.drive(channel);
    if (!mean) choice.power = {};  // what is lost is learned anew
    std::optional<DriveColumns> beside;
    if (current && !other) beside = columns_beside(signals, *current, channel, choice);
    if (beside) other = beside->effort_column;
    const auto drive = drive_config(machine, channel);
    const bool constant = machine.has(section, "torque_constant_Nm_per_A") ||
                          machine.has(section, "force_constant_N_per_A");
    if (!current || !other || !drive || !constant) continue;
    Pair pair;
    pair.channel = channel;
    pair.current = *current;
    pair.other = *other;
    pair.current_name = column_name(signals[*current]);
    pair.other_name = column_name(signals[*other]);
    pair.noise_key = beside && beside->power ? kNoiseOfPower
                     : torque || beside      ? kNoiseOfTorque
                                             : "effort_noise_N";
    if (beside) {
      const double rate_hz = choices.sample_rate_hz;
      pair.power.emplace(*beside, choice, rate_hz > 0 ? 1 / rate_hz : 0);
      pair.lost_unknown = mean && beside->power && !machine.has(section, "power_known_from_rpm");
    }
    pair.per_ampere = drive->effort_per_ampere();
    const double lead = machine.number(section, "lead_m").value_or(0) /
                        machine.number(section, "gear_ratio").value_or(1);
    if (torque && !is_turning(channel)) {
      if (!(lead > 0)) continue;
      pair.per_ampere *= m_per_rad(lead);
    }
    pair.noise_A = machine.number(section, "effort_noise_A").value_or(0);
    pair.noise_other = machine.number(section, pair.noise_key).value_or(0);
    for (const char* effect : {"field-weakening", "torque-saturation"})
      if (machine.has_section("effect." + std::string(name_of(channel)) + "." + effect))
        pair.weakened = true;
    pairs_.push_back(std::move(pair));
  }
}

std::unique_ptr<RowSource> EffortPairs::tap(std::unique_ptr<RowSource> rows,
                                            std::shared_ptr<EffortPairs> pairs) {
  if (pairs->pairs_.empty()) return rows;
  return std::make_unique<HeardRows>(std::move(rows), std::move(pairs));
}

double EffortPairs::Pair::weight_of_other(double noise) const {
  const double a = noise_A * per_ampere, b = noise;
  return a * a / (a * a + b * b);
}

void EffortPairs::hear(TraceRow& row) {
  using enum TraceField::State;
  const double t_s = seconds_from(row.t_ns);
  for (Pair& pair : pairs_) {
    if (pair.weakened) continue;
    TraceField& current = row.fields[pair.current];
    const TraceField& other = row.fields[pair.other];
    std::optional<BesidePower::Reading> power;
    if (pair.power) power = pair.power->hear(row);
    if (current.state != value || other.state != value) continue;
    if (pair.power && !power) continue;
    if (!mean_) {
      bend(pair.last_current, current.value, pair.bends_current);
      bend(pair.last_other, other.value, pair.bends_other);
    }
    if (pair.n > 0 && t_s - pair.from_s >= kBlock_s) pair.end_block();
    if (power && !power->known) continue;
    const double torque = power ? power->torque_Nm : other.value;
    if (power && pair.power->columns().power)
      pair.losses.add(power->power_W, pair.per_ampere * current.value, power->speed_rad_s);
    if (pair.n == 0) pair.from_s = t_s;
    ++pair.n;
    pair.sum_current += current.value;
    pair.sum_other += torque;
    if (!pair.is_mean(mean_)) continue;
    const double noise = power ? pair.power->noise_Nm(pair.noise_other, torque, power->speed_rad_s)
                               : pair.noise_other;
    current.value += pair.weight_of_other(noise) * (torque / pair.per_ampere - current.value);
  }
}

void EffortPairs::Pair::end_block() {
  const double a = sum_current / n, b = sum_other / n / per_ampere;
  n = sum_current = sum_other = 0;
  losses.end_block();
  if (lost_unknown) return;
  static const double kKeeps = std::exp(-kBlock_s / kForgets_s);
  for (double* sum : {&blocks, &x, &y, &xx, &xy, &yy}) *sum *= kKeeps;
  ++blocks;
  x += a, y += b, xx += a * a, xy += a * b, yy += b * b;
  if (const auto now = ratio(); now && now->off) off = true;
}

std::optional<EffortPairs::Ratio> EffortPairs::Pair::ratio() const {
  if (blocks < kFewestBlocks) return {};
  const double sxx = xx - x * x / blocks, sxy = xy - x * y / blocks, syy = yy - y * y / blocks;
  if (!(sxx > 0)) return {};
  Ratio r;
  r.value = sxy / sxx;
  const double left = std::max(0.0, syy - r.value * sxy) / (blocks - 2);
  r.standard_error = kNeighbours * std::sqrt(left / sxx);
  r.off = is_off(r.value, r.standard_error);
  return r;
}

std::string EffortPairs::said(const Pair& pair, const Ratio& ratio) {
  char text[64];
  std::snprintf(text, sizeof text, "%.3g +- %.1g", ratio.value, ratio.standard_error);
  const bool lossy = pair.power && pair.power->columns().power;
  return pair.other_name + (lossy ? ", less its losses, is " : " is ") + text + " times what " +
         pair.current_name + " means by the constant of the machine file";
}

std::vector<EffortPairs::Change> EffortPairs::changes(double t_s) {
  std::vector<Change> all;
  for (Pair& pair : pairs_) {
    if (!pair.off || pair.told) continue;
    pair.told = true;
    const Ratio ratio = pair.ratio().value_or(Ratio{});
    StateChange<double> change;
    change.monitor = MonitorId::signal;
    change.channel = pair.channel;
    change.state = MonitorState::warning;
    change.before = MonitorState::armed;
    change.value = ratio.value;
    change.threshold = ratio.value > 1 ? 1 + kConstantWithin : 1 - kConstantWithin;
    Event event{t_s,
                change.monitor,
                std::string(name_of(pair.channel)),
                change.state,
                change.value,
                change.threshold,
                "1",
                said(pair, ratio) + ": one of them or the constant is off; " + pair.current_name +
                    " alone is taken from here on",
                {}};
    all.push_back({change, std::move(event)});
  }
  return all;
}

std::vector<std::string> EffortPairs::remarks() const {
  std::vector<std::string> all;
  for (const Pair& pair : pairs_) {
    if (pair.weakened)
      all.push_back(pair.other_name + " is not compared with " + pair.current_name +
                    ": the torque constant falls with speed or current");
    else if (pair.lost_unknown)
      all.push_back(pair.other_name + " is not compared with " + pair.current_name +
                    ": what is lost of it is not known; run 'servosense identify idle' on a trace "
                    "that has both");
    else if (pair.is_mean(mean_) && pair.power && pair.power->columns().power)
      all.push_back(
          "the effort of " + std::string(name_of(pair.channel)) + " is the mean of " +
          pair.current_name + " and " + pair.other_name + ", by their noise: they weigh alike at " +
          printed(rpm_from_rad_s(pair.noise_other / (pair.noise_A * pair.per_ampere)), 3) +
          " rpm, faster the power weighs more");
    else if (pair.is_mean(mean_))
      all.push_back("the effort of " + std::string(name_of(pair.channel)) + " is " +
                    printed(100 * pair.weight_of_other(pair.noise_other), 3) + " % " +
                    pair.other_name + ", the rest " + pair.current_name + ", by their noise");
  }
  return all;
}

std::vector<std::size_t> EffortPairs::used() const {
  std::vector<std::size_t> all;
  for (const Pair& pair : pairs_)
    if (pair.is_mean(mean_)) all.push_back(pair.other);
  return all;
}

std::vector<std::string> EffortPairs::learn(MachineFile& machine) {
  std::vector<std::string> all;
  for (Pair& pair : pairs_)
    if (std::string said = learn(pair, machine); !said.empty()) all.push_back(std::move(said));
  return all;
}

std::string EffortPairs::learn(Pair& pair, MachineFile& machine) {
  const auto rounded = [](double value) { return std::strtod(printed(value, 3).c_str(), nullptr); };
  const std::string section(section_of(pair.channel));
  auto ratio = pair.ratio();
  if (pair.power && pair.power->columns().power && !pair.weakened) {
    const auto found = pair.losses.found(PowerReading::kKnownFrom_rad_s);
    ratio.reset();
    if (found) {
      const auto& [value, error] = found->ratio;
      ratio = Ratio{value, error, is_off(value, error)};
      write_losses(machine, section, found->losses,
                   "slower, what braking gives back is as much as the windings take");
    }
  }
  const double noise_A = noise_of(pair.bends_current), noise = noise_of(pair.bends_other);
  const std::string unit = pair.noise_key.substr(pair.noise_key.rfind('_') + 1);
  if (pair.weakened || !ratio || ratio->off || !(noise_A > 0 && noise > 0)) {
    machine.remove(section, "effort_noise_A");
    machine.remove(section, pair.noise_key);
    if (pair.weakened) return {};
    if (ratio && ratio->off)
      return said(pair, *ratio) + ": one of them or the constant is off; " + pair.current_name +
             " alone is taken";
    return pair.other_name + " is not compared with " + pair.current_name +
           ": the run is too short or too even to tell their ratio";
  }
  machine.set(section, "effort_noise_A", rounded(noise_A));
  machine.set(section, pair.noise_key, rounded(noise));
  return said(pair, *ratio) + ": their mean is taken, weighted by their noise, " +
         printed(noise_A, 3) + " A and " + printed(noise, 3) + " " + unit;
}

}  // namespace servosense::cli
