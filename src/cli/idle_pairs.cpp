#include "idle_pairs.hpp"

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <utility>

#include "console.hpp"
#include "servosense/core/units.hpp"
#include "servosense/monitors/pair_config.hpp"
#include "servosense/observer/machine_config.hpp"

namespace servosense::cli {
namespace {

constexpr const char* kFoundBy = "servosense identify idle, motor against load";
constexpr double kEvery_s = 0.004;  // far below what the filter of the pairs lets pass
constexpr double kGreatestGain_per_s =
    300;                                // of position loops: convention, three times usual ones
constexpr double kUsualDamping = 0.05;  // of a coupling: bolted joints, screws and belts

std::string effect_of(Channel channel, const char* name) {
  return "effect." + std::string(name_of(channel)) + "." + name;
}

double short_number(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.8g", value);
  return std::strtod(text, nullptr);
}

std::string error_of(const Estimate& e) {
  char text[64];
  std::snprintf(text, sizeof text, "+- %.3g (standard error)", e.standard_error);
  return text;
}

std::string list_text(const std::vector<double>& values) {
  std::string all;
  for (const double value : values) {
    char text[40];
    std::snprintf(text, sizeof text, "%s%.8g", all.empty() ? "" : ", ", value);
    all += text;
  }
  return all;
}

bool is_own(const MachineFile& machine, const std::string& section) {
  return !machine.has_section(section) || machine.text(section, "provenance") == kFoundBy;
}

const char* width_key(Channel channel) { return is_turning(channel) ? "width_rad" : "width_m"; }

void write_coupling(MachineFile& machine, Channel channel, const LoadPath& load, double inertia,
                    double sample_rate_hz, std::vector<std::string>& remarks) {
  const std::string section = effect_of(channel, "flexible-coupling");
  if (!is_own(machine, section)) return;
  machine.remove_section(section);
  if (!load.has_compliance()) return;
  const std::string name(name_of(channel));
  const double moving =
      is_turning(channel) ? 0 : machine.number(section_of(channel), "moving_mass_kg").value_or(0);
  const double share = inertia > 0 ? moving / inertia : 0;
  if (!(share >= 0.01 && share <= 0.99)) {
    remarks.push_back(name +
                      ": the compliance is not written as flexible-coupling, which needs the part "
                      "of the inertia behind it" +
                      (is_turning(channel) ? "" : "; write moving_mass_kg of the stage alone"));
    return;
  }
  const double free = 1 / std::sqrt(1 - share);
  const Estimate resonance{load.held_resonance_hz.value * free,
                           load.held_resonance_hz.standard_error * free};
  if (!(resonance.value < 0.4 * sample_rate_hz)) return;
  machine.set(section, "resonance_hz", short_number(resonance.value), error_of(resonance));
  machine.set(section, "damping_ratio", kUsualDamping, "not found here: a usual one");
  machine.set(section, is_turning(channel) ? "inertia_share" : "mass_share", short_number(share),
              "moving_mass_kg over the mass that was found");
  machine.set(section, "provenance", kFoundBy);
  machine.set(section, "used_by_monitors", "no");
}

/// The gain of the position loop, where the machine file has none.
void write_position_gain(MachineFile& machine, Channel channel, const Estimate& time_s,
                         std::vector<std::string>& remarks) {
  constexpr const char* kKey = "position_gain_per_s";
  const std::string name(name_of(channel)), section = "controller." + name;
  if (machine.has(section, kKey) || !(time_s.value > 0)) return;
  const Estimate gain{1 / time_s.value, time_s.standard_error / (time_s.value * time_s.value)};
  if (gain.value > kGreatestGain_per_s) {
    remarks.push_back(name +
                      ": it follows its command closer than a position loop alone does, so feed "
                      "forward is at work, and the gain of the loop is not told");
    return;
  }
  machine.set(section, kKey, short_number(gain.value),
              error_of(gain) + ", feed forward supposed off");
  remarks.push_back(name +
                    ": position_gain_per_s is what the following error says of a loop without feed "
                    "forward; correct it if there is some");
}

}  // namespace

std::unique_ptr<RowSource> PairRecorder::tap(std::unique_ptr<RowSource> rows,
                                             const MachineFile& machine) {
  readers_ = pair_readers(machine, rows->signals());
  for (const PairReader& reader : readers_) {
    const PairedColumns& columns = reader.columns();
    PairRecord record;
    record.columns = columns;
    if (const auto drive = drive_config(machine, columns.channel)) {
      const DriveInputConfig input = drive->input(columns.drive.signal, 1e-3);
      if (columns.drive.signal.motion == MotionKind::counts)
        record.unit_per_count = input.unit_per_count;
      record.unit_per_turn =
          drive->disturbance_observer(1e-3, drive->observer()).drive.unit_per_turn;
    }
    records_.push_back(std::move(record));
  }
  if (readers_.empty()) return rows;
  return std::make_unique<PairRows>(std::move(rows), readers_, [this](std::size_t i) {
    std::vector<PairSample>& samples = records_[i].samples;
    const PairSample& now = readers_[i].sample();
    if (samples.empty() || now.t_s - samples.back().t_s >= kEvery_s) samples.push_back(now);
  });
}

const PairRecord* PairRecorder::of(Channel channel) const {
  for (const PairRecord& record : records_)
    if (record.columns.channel == channel) return &record;
  return nullptr;
}

std::optional<EffectSetting> backlash_found(const MachineFile& machine, Channel channel,
                                            const LearnedPairs& pairs) {
  if (!pairs.load || !pairs.load->has_backlash() ||
      !is_own(machine, effect_of(channel, "backlash")))
    return std::nullopt;
  EffectSetting setting;
  setting.effect = drive_effect_index("backlash");
  setting.parameters[0].value[0] = pairs.load->backlash.value;
  setting.parameters[0].count = 1;
  return setting;
}

void write_pairs(MachineFile& machine, Channel channel, const LearnedPairs& pairs,
                 bool monitors_read_less, double inertia, double sample_rate_hz,
                 std::vector<std::string>& remarks) {
  const std::string section = pair_section(channel);
  for (const LearnedPair& pair : pairs.pairs) {
    const PairKeys keys = pair_keys(pair.kind, channel);
    char comment[80];
    std::snprintf(comment, sizeof comment, "idle: at most %.3g", pair.largest);
    machine.set(section, keys.band, short_number(pair.band), comment);
    machine.set(section, keys.terms, list_text(pair.terms.list()));
  }
  if (!pairs.pairs.empty()) {
    machine.set(section, kIdleEffortTerms, list_text(pairs.idle_effort.list()));
    machine.set(section, "provenance", kFoundBy);
  }
  if (pairs.following_time_s)
    write_position_gain(machine, channel, *pairs.following_time_s, remarks);
  if (!pairs.load) return;
  const std::string backlash = effect_of(channel, "backlash");
  if (is_own(machine, backlash)) {
    machine.remove_section(backlash);
    if (pairs.load->has_backlash()) {
      machine.set(backlash, width_key(channel), short_number(pairs.load->backlash.value),
                  error_of(pairs.load->backlash));
      machine.set(backlash, "provenance", kFoundBy);
      if (!monitors_read_less) machine.set(backlash, "used_by_monitors", "no");
    }
  }
  write_coupling(machine, channel, *pairs.load, inertia, sample_rate_hz, remarks);
}

void print_pairs(Channel channel, const LearnedPairs& pairs) {
  const bool turns = is_turning(channel);
  const auto row = [](const char* what, const Estimate& e, const char* unit) {
    say("  %-22s %12.6g +- %-10.3g %s\n", what, e.value, e.standard_error, unit);
  };
  if (pairs.load) {
    const LoadPath& load = *pairs.load;
    const char* way = turns ? "rad" : "m";
    row(load.has_backlash() ? "backlash" : "backlash, none shown", load.backlash, way);
    if (load.has_compliance()) {
      row("effort per difference", load.effort_per_difference, turns ? "Nm/rad" : "N/m");
      row("load swings at", load.held_resonance_hz, "Hz, motor held");
    }
    row("lead error, slope", load.slope, "");
    if (load.cyclic[0].standard_error > 0) {
      row("lead error, each turn", load.cyclic[0], way);
      row("twice a turn", load.cyclic[1], way);
    }
  }
  if (pairs.following_time_s) row("following error", *pairs.following_time_s, "s of velocity");
  if (pairs.command_delay_s) row("current loop", *pairs.command_delay_s, "s late");
  for (const LearnedPair& pair : pairs.pairs)
    say("  band of %-14s %12.4g %s\n", std::string(name_of(pair.kind)).c_str(), pair.band,
        pair_unit(pair.kind, channel));
}

void write_pairs_json(JsonWriter& json, Channel channel, const LearnedPairs& pairs) {
  const bool turns = is_turning(channel);
  const auto estimate = [&](const char* key, const Estimate& e) {
    json.key(key);
    json.begin_object();
    json.member("value", e.value);
    json.member("standard_error", e.standard_error);
    json.end_object();
  };
  if (pairs.load) {
    const LoadPath& load = *pairs.load;
    estimate(turns ? "backlash_rad" : "backlash_m", load.backlash);
    if (load.has_compliance()) {
      estimate(turns ? "effort_per_difference_Nm_per_rad" : "effort_per_difference_N_per_m",
               load.effort_per_difference);
      estimate("held_resonance_hz", load.held_resonance_hz);
    }
    estimate("lead_error_slope", load.slope);
    if (load.cyclic[0].standard_error > 0) {
      estimate(turns ? "lead_error_once_rad" : "lead_error_once_m", load.cyclic[0]);
      estimate(turns ? "lead_error_twice_rad" : "lead_error_twice_m", load.cyclic[1]);
    }
  }
  if (pairs.following_time_s) estimate("following_time_s", *pairs.following_time_s);
  if (pairs.command_delay_s) estimate("command_delay_s", *pairs.command_delay_s);
  json.objects("pairs", pairs.pairs, [&](const LearnedPair& pair) {
    json.member("pair", name_of(pair.kind));
    json.member("unit", pair_unit(pair.kind, channel));
    json.member("largest", pair.largest);
    json.member("band", pair.band);
  });
}

}  // namespace servosense::cli
