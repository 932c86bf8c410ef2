#include "servosense/identify/free_decay.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "free_decay_fit.hpp"
#include "servosense/io/sample_period.hpp"

namespace servosense {
namespace {

using free_decay::DecayFit;
using free_decay::Pole;
using free_decay::Stretch;

constexpr std::size_t kLeastRecord = 400;   // of a record
constexpr double kGapPeriods = 1.5;         // longer steps cut a record in two
constexpr double kRmsWindow_s = 0.05;       // of the rms, while the rotation is unknown
constexpr std::size_t kLeastWindow = 32;    // samples
constexpr std::size_t kWindowsOfQuiet = 4;  // shorter ones are no end of a cut
constexpr std::size_t kMostQuiet = 10;      // windows of it that are fitted
constexpr double kQuiet = 1.5;              // times the lowest rms that lasts
constexpr double kQuietOfLoud = 0.02;       // or this share of the highest
constexpr double kLoud = 2;                 // times the rms of the quiet
constexpr double kLongestDecay_s = 3;       // looked for before the quiet
constexpr std::size_t kMostSamples = 1U << 15;
constexpr std::size_t kBlock = 8;       // samples: how closely the end of the forcing is told
constexpr double kCertain = 3;          // standard errors
constexpr double kSpeedError = 5e-4;    // of a rotation that is told by readings of speed
constexpr double kRings = 0.5;          // beyond it nothing rings
constexpr double kKnownDamping = 0.2;   // relative standard error
constexpr double kSameLine = 0.01;      // of its frequency: what was turned down before
constexpr double kRare = 0.25;          // share of the decays below which a pole is chance
constexpr std::size_t kManyDecays = 4;  // from which on it is asked

std::string text(double number) {
  char digits[32];
  std::snprintf(digits, sizeof digits, "%.4g", number);
  return digits;
}

/// Stretches of regular samples.
struct Run {
  std::vector<double> t_s, value, turns;
};
std::vector<Run> regular_runs(const DecayRecord& record, double period_s) {
  std::vector<Run> runs;
  double last_s = 0;
  for (std::size_t i = 0; i < record.t_s.size(); ++i) {
    if (!std::isfinite(record.value[i])) continue;
    if (runs.empty() || record.t_s[i] - last_s > kGapPeriods * period_s) runs.emplace_back();
    last_s = record.t_s[i];
    runs.back().t_s.push_back(last_s);
    runs.back().value.push_back(record.value[i]);
    if (!record.turns.empty()) runs.back().turns.push_back(record.turns[i]);
  }
  return runs;
}

/// Rms about the mean of windows that overlap by three quarters.
struct Levels {
  std::size_t window = 0, hop = 0;
  std::vector<double> rms;
};
Levels levels_of(const Run& run, double period_s) {
  double window_s = kRmsWindow_s;
  if (!run.turns.empty()) {
    const double turns = std::abs(run.turns.back() - run.turns.front());
    const double turn_s = (run.t_s.back() - run.t_s.front()) / turns;
    if (turns >= 1) window_s = turn_s;
  }
  Levels l;
  l.window = std::max(kLeastWindow, static_cast<std::size_t>(std::lround(window_s / period_s)));
  l.hop = l.window / 4;
  for (std::size_t at = 0; at + l.window <= run.value.size(); at += l.hop) {
    double sum = 0, squares = 0;
    for (std::size_t i = at; i < at + l.window; ++i) sum += run.value[i];
    const double mean = sum / static_cast<double>(l.window);
    for (std::size_t i = at; i < at + l.window; ++i)
      squares += (run.value[i] - mean) * (run.value[i] - mean);
    l.rms.push_back(std::sqrt(squares / static_cast<double>(l.window)));
  }
  return l;
}

struct End {
  std::size_t loud_from, quiet_from, quiet_to;  ///< samples
};

/// Where the level falls to the lowest that lasts, and stays.
std::vector<End> ends_of_cuts(const Levels& l) {
  const std::size_t lasting = 4 * kWindowsOfQuiet - 3;
  std::vector<End> ends;
  if (l.rms.size() < lasting) return ends;
  double lowest = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i + lasting <= l.rms.size(); ++i) {
    const auto at = l.rms.begin() + static_cast<std::ptrdiff_t>(i);
    lowest = std::min(lowest, *std::max_element(at, at + static_cast<std::ptrdiff_t>(lasting)));
  }
  const double highest = *std::max_element(l.rms.begin(), l.rms.end());
  const double quiet = std::max(kQuiet * lowest, kQuietOfLoud * highest);
  const std::size_t none = l.rms.size();
  std::size_t loud = none;
  for (std::size_t i = 0; i < l.rms.size();) {
    if (l.rms[i] > quiet) {
      if (loud == none && l.rms[i] > kLoud * lowest) loud = i;
      ++i;
      continue;
    }
    std::size_t to = i;
    while (to < l.rms.size() && l.rms[to] <= quiet) ++to;
    if (to - i >= lasting) {
      if (loud != none) ends.push_back({loud * l.hop, i * l.hop, (to - 1) * l.hop + l.window});
      loud = none;
    }
    i = to;
  }
  return ends;
}

/// The samples about an end: what may ring, and the quiet after it.
Stretch stretch_about(const Run& run, const Levels& l, const End& end, double period_s,
                      std::size_t& first) {
  const auto longest = static_cast<std::size_t>(kLongestDecay_s / period_s);
  const std::size_t quiet_samples =
      std::min(end.quiet_to - end.quiet_from, std::max(kMostQuiet * l.window, kLeastRecord));
  const std::size_t before =
      std::min(longest, kMostSamples - std::min(kMostSamples, quiet_samples));
  first = std::max(end.loud_from, end.quiet_from - std::min(end.quiet_from, before));
  const auto from = static_cast<std::ptrdiff_t>(first);
  const auto to = static_cast<std::ptrdiff_t>(end.quiet_from + quiet_samples);
  Stretch s{.value = {run.value.begin() + from, run.value.begin() + to},
            .turns = {},
            .period_s = period_s,
            .quiet = end.quiet_from - first};
  if (!run.turns.empty()) s.turns = {run.turns.begin() + from, run.turns.begin() + to};
  double mean = 0;
  for (std::size_t i = s.quiet; i < s.value.size(); ++i)
    mean += s.value[i] / static_cast<double>(s.value.size() - s.quiet);
  for (double& value : s.value) value -= mean;
  return s;
}

/// First sample from which on decays describe the stretch: from the quiet backwards by longer and
/// longer steps, then by halves.
std::size_t end_of_forcing(const Stretch& s, const std::vector<int>& forced,
                           const FreeDecayOptions& o) {
  const auto holds = [&](std::size_t from) {
    return free_decay::fit_decays(s, from, forced, o.from_hz, o.to_hz).holds;
  };
  std::size_t good = s.quiet, bad = good, step = 2 * kBlock;
  while (bad == good && good > 0) {
    const std::size_t next = good - std::min(good, step);
    bad = next;
    if (holds(next)) good = next;
    step *= 2;
  }
  while (good - bad > kBlock) {
    const std::size_t middle = (good + bad) / 2;
    (holds(middle) ? good : bad) = middle;
  }
  return std::min(good + kBlock, s.quiet);
}

/// Why a pole is no mode; empty: it is one.
std::string why_forced(const Pole& p, double rotation_hz) {
  if (!(p.decay_per_s.value > kCertain * p.decay_per_s.standard_error))
    return "does not decay: something still drives it";
  if (p.damping_ratio.value > kRings) return "dies within a period: nothing rings";
  if (!std::isfinite(rotation_hz)) return {};
  const double hz = p.frequency_hz.value, multiple = std::round(hz / rotation_hz);
  const double off = std::abs(hz - multiple * rotation_hz);
  if (multiple < 1 || off > kCertain * p.frequency_hz.standard_error + kSpeedError * hz) return {};
  return "stands at " + text(multiple) + " times the rotation: forced, or not told from it";
}

/// Once for all decays that show it.
void turn_down(std::vector<PoleTurnedDown>& all, const PoleTurnedDown& pole) {
  const bool known = std::any_of(all.begin(), all.end(), [&](const PoleTurnedDown& p) {
    return p.reason == pole.reason &&
           std::abs(p.frequency_hz - pole.frequency_hz) < kSameLine * pole.frequency_hz;
  });
  if (!known) all.push_back(pole);
}

/// One mode in the decays that show it.
struct Group {
  std::vector<Pole> poles;
  std::vector<std::size_t> of;  ///< decay of each
};

Estimate weighted_mean(const std::vector<Pole>& poles, Estimate Pole::*of) {
  double weights = 0, sum = 0, misfit = 0;
  for (const Pole& p : poles) {
    const Estimate& e = p.*of;
    const double weight = 1 / (e.standard_error * e.standard_error);
    weights += weight, sum += weight * e.value;
  }
  const double mean = sum / weights;
  for (const Pole& p : poles) {
    const double off = ((p.*of).value - mean) / (p.*of).standard_error;
    misfit += off * off;
  }
  const double freedom = std::max(1.0, static_cast<double>(poles.size()) - 1);
  return {mean, std::sqrt(std::max(1.0, misfit / freedom) / weights)};
}

bool same_mode(const Pole& a, const Pole& b) {
  const double apart = std::abs(a.natural_frequency_hz.value - b.natural_frequency_hz.value);
  const double half_width = std::max(a.damping_ratio.value * a.natural_frequency_hz.value,
                                     b.damping_ratio.value * b.natural_frequency_hz.value);
  return apart < half_width + kCertain * std::hypot(a.natural_frequency_hz.standard_error,
                                                    b.natural_frequency_hz.standard_error);
}

void add_to_groups(std::vector<Group>& groups, const Pole& pole, std::size_t decay) {
  for (Group& g : groups)
    if (g.of.back() != decay && same_mode(g.poles.front(), pole)) {
      g.poles.push_back(pole), g.of.push_back(decay);
      return;
    }
  groups.push_back({{pole}, {decay}});
}

FreeDecayMode mode_of(const Group& g) {
  FreeDecayMode mode;
  mode.natural_frequency_hz = weighted_mean(g.poles, &Pole::natural_frequency_hz);
  mode.damping_ratio = weighted_mean(g.poles, &Pole::damping_ratio);
  mode.decays = g.poles.size();
  if (mode.damping_ratio.standard_error > kKnownDamping * mode.damping_ratio.value)
    mode.doubt = "its damping is known within " +
                 text(100 * mode.damping_ratio.standard_error / mode.damping_ratio.value) +
                 " % only; record more ends of cuts";
  return mode;
}

}  // namespace

Expected<FreeDecayIdentification> identify_free_decays(std::span<const DecayRecord> records,
                                                       const FreeDecayOptions& options) {
  FreeDecayIdentification out;
  std::vector<Group> groups;
  const std::string first = records.empty() ? "no record" : records.front().name;
  double done = 0;
  for (const DecayRecord& record : records) {
    const double period_s = sample_period(record.t_s);
    const std::vector<Run> runs = regular_runs(record, period_s);
    std::size_t most = 0;
    for (const Run& run : runs) most = std::max(most, run.value.size());
    if (most < kLeastRecord || !(period_s > 0))
      return data_error(record.name + ": " + std::to_string(most) +
                        " samples without a gap are too few; give a record of whole cuts");
    for (const Run& run : runs) {
      const Levels levels = levels_of(run, period_s);
      const std::vector<End> ends = ends_of_cuts(levels);
      for (const End& end : ends) {
        ++out.ends;
        std::size_t at = 0;
        const Stretch s = stretch_about(run, levels, end, period_s, at);
        const std::vector<int> forced = free_decay::forced_lines(s);
        const std::size_t from = end_of_forcing(s, forced, options);
        const DecayFit fit =
            free_decay::fit_decays(s, from, forced, options.from_hz, options.to_hz);
        FreeDecay decay{.record = record.name,
                        .from_s = run.t_s[at + from],
                        .to_s = run.t_s[at + s.value.size() - 1]};
        if (!s.turns.empty())
          decay.rotation_hz =
              std::abs(s.turns.back() - s.turns[from]) / (decay.to_s - decay.from_s);
        bool rings = false;
        for (const Pole& pole : fit.poles) {
          const std::string why = why_forced(pole, decay.rotation_hz);
          if (why.empty())
            add_to_groups(groups, pole, out.decays.size()), rings = true;
          else
            turn_down(out.turned_down, {pole.frequency_hz.value, pole.damping_ratio.value, why});
        }
        if (rings) {
          const auto begin = static_cast<std::ptrdiff_t>(at + from);
          const auto last = static_cast<std::ptrdiff_t>(at + s.value.size());
          decay.t_s = {run.t_s.begin() + begin, run.t_s.begin() + last};
          decay.measured = {s.value.begin() + static_cast<std::ptrdiff_t>(from), s.value.end()};
          decay.fitted = fit.fitted;
          out.decays.push_back(std::move(decay));
        }
        if (options.progress)
          options.progress(
              (done + static_cast<double>(end.quiet_to) / static_cast<double>(run.value.size())) /
              static_cast<double>(records.size()));
      }
    }
    ++done;
  }
  if (out.ends == 0)
    return data_error(first +
                      ": no cut ends in it: it never falls to a level that lasts four turns of the "
                      "spindle and is half as loud; record from the cut on into the air");
  for (const Group& g : groups) {
    const bool rare =
        out.decays.size() >= kManyDecays &&
        static_cast<double>(g.poles.size()) < kRare * static_cast<double>(out.decays.size());
    const FreeDecayMode mode = mode_of(g);
    if (rare)
      out.turned_down.push_back({mode.natural_frequency_hz.value, mode.damping_ratio.value,
                                 "is in " + std::to_string(g.poles.size()) + " of " +
                                     std::to_string(out.decays.size()) + " decays only"});
    else
      out.modes.push_back(mode);
  }
  if (out.modes.empty())
    return data_error(first + ": " + std::to_string(out.ends) +
                      (out.ends == 1 ? " cut ends" : " cuts end") +
                      ", but nothing rings then that the spindle does not force; take a "
                      "column nearer to the tool (an accelerometer), or 'identify impact'");
  std::sort(out.modes.begin(), out.modes.end(), [](const auto& l, const auto& r) {
    return l.natural_frequency_hz.value < r.natural_frequency_hz.value;
  });
  return out;
}

}  // namespace servosense
