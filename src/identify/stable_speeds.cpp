#include "servosense/identify/stable_speeds.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>

#include "servosense/core/units.hpp"
#include "servosense/identify/stability_lobes.hpp"
#include "stable_speeds_mode.hpp"
#include "stable_speeds_ramps.hpp"
#include "stable_speeds_ridge.hpp"

namespace servosense {
namespace {

constexpr std::size_t kJackknifeBlocks = 8;
constexpr double kOlderShare = 0.2;  // of the waves under a tooth where chatter is strongest; 0.1
                                     // to 0.3 do as well for tools drawn at random
constexpr double kSameFrequency =
    0.05;  // views and ramps of one mode differ by less; lobes by more
constexpr double kExplained = kMisfitByLot / 3;  // largest misfit that explains a view
constexpr double kTellsApart =
    1.3;  // times the misfit: a view tells one frequency from another that
          // comes no closer; without it, nearly twice as many are wrong
constexpr double kTriedFrequencies = 60;  // about as many guesses are fitted ...
constexpr double kByChance = 0.05;        // ... and so seldom may one of them do by chance
constexpr double kModelError = 0.01;  // standard error of one effective mode, of the speed: 19 of
                                      // 20 speeds of development records are within twice this
constexpr double kSeenOverNoise = 6;  // power of chatter of which enough stands out in eight teeth
constexpr double kSomeShare = 0.05;   // of the teeth; noise alone stands out less often
constexpr double kWeakChatter = 0.1;  // of the strongest: chatter within a lobe, next to its pocket
constexpr double kTeethStandOut = 10;  // power of the tooth passing over that of noise
constexpr double kChatterOfCut = 0.1;  // of the mean torque: amplitude of chatter in the lowest
                                       // sidebands

std::string text(const char* format, double a, double b = 0, double c = 0) {
  char buffer[400];
  // A format may take fewer than three.
  // cppcheck-suppress wrongPrintfScanfArgNum
  std::snprintf(buffer, sizeof buffer, format, a, b, c);
  return buffer;
}

void match_minima(StableSpeeds& result) {
  for (std::size_t i = 0; i < result.pockets.size(); ++i) {
    StableSpeed& pocket = result.pockets[i];
    const double here = pocket.spindle_speed_rpm;
    // The minimum lags: it lies between this pocket and the next one down, half way at most.
    double gap = i > 0 ? here - result.pockets[i - 1].spindle_speed_rpm : here / (pocket.waves + 1);
    gap *= 0.6;
    for (const auto& ramp : result.minima)
      for (const PowerMinimum& m : ramp)
        if (m.accepted && m.spindle_speed_rpm > here - gap &&
            m.spindle_speed_rpm < here + gap / 3 &&
            !(std::abs(m.spindle_speed_rpm - here) >= std::abs(pocket.minimum_rpm - here)))
          pocket.minimum_rpm = m.spindle_speed_rpm;
  }
}

/// A ramp in the cut, cut out of its record.
struct Ramp {
  RampInCut where;
  CuttingTorqueTrace cut;
};

std::vector<double> part_of(const std::vector<double>& x, const RampSpan& span) {
  if (x.empty()) return {};
  return {x.begin() + static_cast<std::ptrdiff_t>(span.first),
          x.begin() + static_cast<std::ptrdiff_t>(span.last)};
}

Ramp ramp_of(const CuttingTorqueTrace& record, std::size_t number, const RampSpan& span) {
  Ramp ramp;
  ramp.cut.sample_rate_hz = record.sample_rate_hz;
  ramp.cut.count_torque_Nm = record.count_torque_Nm;
  ramp.cut.torque_Nm = part_of(record.torque_Nm, span);
  ramp.cut.spindle_speed_rad_s = part_of(record.spindle_speed_rad_s, span);
  ramp.cut.inertia_torque_Nm = part_of(record.inertia_torque_Nm, span);
  ramp.where.record = number;
  ramp.where.from_s = static_cast<double>(span.first) / record.sample_rate_hz;
  ramp.where.to_s = static_cast<double>(span.last) / record.sample_rate_hz;
  return ramp;
}

/// Views of the torque, from the one that changes it least to the one that noise touches least.
std::vector<TorqueView> views_of(const std::vector<Ramp>& ramps, double tooth_passing_hz) {
  std::vector<TorqueView> views = {{false, 0}};
  for (const double teeth : {4.0, 2.0, 1.0}) views.push_back({false, teeth * tooth_passing_hz});
  bool inertia = true;
  for (const Ramp& r : ramps) inertia = inertia && !r.cut.inertia_torque_Nm.empty();
  for (const double teeth : {1.0, 0.5, 0.3}) views.push_back({inertia, teeth * tooth_passing_hz});
  return views;
}

/// What one view says.
struct Answer {
  TorqueView view;
  std::vector<ChatterOfCut> chatter;  // of each ramp
  std::vector<std::size_t> used;      // ramps that chatter
  std::vector<ChatterMode> found;     // from all of them, at all lobe numbers
  std::vector<ToothChatter> clear;    // teeth that those stand on
  std::vector<ChatterMode> modes;     // of each used one; empty: the natural frequency is not known
  double share = 0;                   // largest
};

/// Chatter grows until the tool leaves the work, unless `leaves_work` knows better of a ramp.
Expected<Answer> look(const std::vector<Ramp>& ramps, const StableSpeedOptions& options,
                      const TorqueView& view, double highest_hz, std::vector<bool>& leaves_work) {
  Answer answer;
  answer.view = view;
  std::vector<ToothChatter> joint;
  for (const Ramp& ramp : ramps) {
    auto chatter = chatter_of(ramp.cut, options, view);
    if (!chatter) return chatter.error();
    answer.share = std::max(answer.share, chatter->share);
    if (chatter->share >= kChatteringShare) {
      // Only the whole band shows all of it.
      if (!view.inertia_alone && view.cutoff_hz <= 0)
        leaves_work[answer.chatter.size()] = chatter->leaves_work;
      answer.used.push_back(answer.chatter.size());
      joint.insert(joint.end(), chatter->chatter.begin(), chatter->chatter.end());
    }
    answer.chatter.push_back(std::move(*chatter));
  }
  // With the tooth angle of both branches in one fit, every ramp must chatter on the same side.
  for (const std::size_t r : answer.used)
    if (answer.chatter[r].above != answer.chatter[answer.used.front()].above) return answer;
  const std::vector<ToothChatter> clear = strong(joint);
  if (clear.size() < 16) return answer;
  answer.clear = clear;
  answer.found = search_modes(clear, highest_hz);
  return answer;
}

bool same_frequency(const ChatterMode& a, const ChatterMode& b) {
  return std::abs(a.frequency_hz / b.frequency_hz - 1) < kSameFrequency;
}

/// What the view has found at the frequency of `mode`; null: nothing.
const ChatterMode* found_at(const Answer& view, const ChatterMode& mode) {
  const ChatterMode* best = nullptr;
  for (const ChatterMode& m : view.found)
    if (same_frequency(m, mode) && (best == nullptr || m.misfit < best->misfit)) best = &m;
  return best;
}

double misfit_in(const Answer& view, const ChatterMode& mode) {
  const ChatterMode* found = found_at(view, mode);
  return found == nullptr ? kMisfitByLot : std::clamp(found->misfit, 1e-9, kMisfitByLot);
}

/// How much better than by lot all views together are explained: every tooth counts, a view that
/// shows noise says nothing for any.
double evidence_of(const std::vector<Answer>& views, const ChatterMode& mode) {
  double sum = 0;
  for (const Answer& view : views)
    sum += static_cast<double>(view.clear.size()) * std::log(kMisfitByLot / misfit_in(view, mode));
  return sum;
}

/// The natural frequency that explains all views best comes first; then those that no view tells
/// from it. Empty: no view is explained.
std::vector<ChatterMode> likely_modes(const std::vector<Answer>& views) {
  const ChatterMode* best = nullptr;
  double most = 0;
  for (const Answer& view : views)
    for (const ChatterMode& m : view.found)
      if (const double evidence = evidence_of(views, m); evidence > most)
        most = evidence, best = &m;
  if (best == nullptr) return {};
  // Windows of eight teeth overlap: eight teeth count as one.
  if (most < 8 * std::log(kTriedFrequencies / kByChance)) return {};
  const auto explains = [&](const Answer& view) { return misfit_in(view, *best) < kExplained; };
  if (std::none_of(views.begin(), views.end(), explains)) return {};
  std::vector<ChatterMode> likely = {*best};
  for (const Answer& view : views)
    for (const ChatterMode& m : view.found) {
      const bool known = std::any_of(likely.begin(), likely.end(),
                                     [&](const ChatterMode& l) { return same_frequency(l, m); });
      const bool told = std::any_of(views.begin(), views.end(), [&](const Answer& v) {
        return explains(v) && misfit_in(v, m) > kTellsApart * misfit_in(v, *best);
      });
      if (!known && !told) likely.push_back(m);
    }
  return likely;
}

/// The views that the mode explains, with its closer fit to each ramp.
std::vector<Answer> explained(const std::vector<Answer>& views, const ChatterMode& mode,
                              const std::vector<bool>& leaves_work) {
  std::vector<Answer> result;
  for (const Answer& view : views) {
    if (!(misfit_in(view, mode) < kExplained)) continue;
    Answer answer = view;
    const ChatterMode& own = *found_at(view, mode);
    for (const std::size_t r : view.used) {
      const std::vector<ToothChatter> clear = strong(view.chatter[r].chatter);
      auto closer = fit_from(clear, own, leaves_work[r] ? kOlderShare : 0);
      if (!closer || !same_frequency(*closer, own)) closer = fit_from(clear, own);
      if (closer && same_frequency(*closer, own)) answer.modes.push_back(*closer);
    }
    if (answer.modes.size() == view.used.size()) result.push_back(std::move(answer));
  }
  return result;
}

/// The mode again, each time without another eighth of the ramp.
std::vector<ChatterMode> jackknife(const std::vector<ToothChatter>& chatter,
                                   const ChatterMode& mode) {
  std::vector<ChatterMode> all;
  const std::size_t n = chatter.size();
  for (std::size_t block = 0; block < kJackknifeBlocks; ++block) {
    std::vector<ToothChatter> rest;
    for (std::size_t i = 0; i < n; ++i)
      if (i * kJackknifeBlocks / n != block) rest.push_back(chatter[i]);
    if (auto m = fit_from(rest, mode, mode.older_share)) all.push_back(*m);
  }
  return all;
}

/// A mode that one view shows of one ramp, and how far it may be off.
struct RampView {
  ChatterMode mode;
  std::vector<ChatterMode> without;
  double weight = 0;  // all together are 1
};

/// Speeds as the mean of all views and ramps, each with the weight that its phase error gives it:
/// wide views have their errors from noise, narrow ones from the few sidebands in them.
/// Returns the speeds between which they were sought.
SpeedInterval find_pockets(const std::vector<Answer>& answers, const StableSpeedOptions& options,
                           StableSpeeds& result) {
  std::vector<RampView> estimates;
  double from = std::numeric_limits<double>::infinity(), to = 0;
  double seen_from = from, seen_to = to;  // chatter
  std::size_t ramps = 0;
  for (const Answer& answer : answers) {
    ramps = std::max(ramps, answer.used.size());
    for (std::size_t i = 0; i < answer.used.size(); ++i) {
      const ChatterOfCut& c = answer.chatter[answer.used[i]];
      estimates.push_back({answer.modes[i], jackknife(strong(c.chatter), answer.modes[i]),
                           1 / std::pow(answer.modes[i].phase_error_rad, 2)});
      std::vector<double> speed_rpm;
      for (const ToothChatter& t : c.chatter)
        speed_rpm.push_back(60 / (options.teeth * t.period_s));
      // A pocket within its own error of an end may well lie outside, and one of its lobes does.
      from = std::min(from, 1.01 * c.slowest_rpm);
      to = std::max(to, 0.99 * c.fastest_rpm);
      seen_from = std::min(seen_from, percentile(speed_rpm, 0.01));
      seen_to = std::max(seen_to, percentile(speed_rpm, 0.99));
    }
  }
  double weights = 0;
  for (const RampView& e : estimates) weights += e.weight;
  for (RampView& e : estimates) e.weight /= weights;
  result.natural_frequency_hz = result.damping_ratio = result.phase_error_rad = 0;
  for (const RampView& e : estimates) {
    result.natural_frequency_hz += e.weight * e.mode.frequency_hz;
    result.damping_ratio += e.weight * e.mode.damping;
    result.phase_error_rad += e.weight * e.mode.phase_error_rad;
  }
  const Answer& first = answers.front();
  const bool above = first.chatter[first.used.front()].above;
  for (int waves = 1; waves < 1000; ++waves) {
    const auto speed_of = [&](const ChatterMode& m) {
      return single_mode_pocket_rpm(m.frequency_hz, m.damping, options.teeth, waves, above);
    };
    StableSpeed pocket;
    double low = std::numeric_limits<double>::infinity(), high = 0;
    double variance = 0, squares = 0;
    for (const RampView& e : estimates) {
      const double speed = speed_of(e.mode);
      pocket.spindle_speed_rpm += e.weight * speed;
      squares += e.weight * speed * speed;
      low = std::min(low, speed);
      high = std::max(high, speed);
      const auto parts = static_cast<double>(e.without.size());
      double sum = 0, sum_squares = 0;
      for (const ChatterMode& m : e.without) {
        const double off = speed_of(m) - speed;
        sum += off;
        sum_squares += off * off;
      }
      if (parts > 1) variance += e.weight * (parts - 1) / parts * (sum_squares - sum * sum / parts);
    }
    const double here = pocket.spindle_speed_rpm;
    // Views of one ramp share their teeth, ramps do not.
    variance /= static_cast<double>(ramps);
    variance += std::max(0.0, squares - here * here) + std::pow(kModelError * here, 2);
    pocket.waves = waves;
    pocket.spread_rpm = high - low;
    pocket.uncertainty_rpm = 2 * std::sqrt(variance);
    const double lobe = here / (waves + 1);
    if (here < from || here < seen_from - lobe / 2) break;
    if (here <= to && here < seen_to + lobe / 2)
      result.pockets.insert(result.pockets.begin(), pocket);
  }
  return {std::max(from, seen_from), std::min(to, seen_to)};
}

/// Of another mode that explains the chatter as well: the speeds at which both have a pocket stay,
/// their uncertainty reaches to the other.
void keep_common(const std::vector<StableSpeed>& others, std::vector<StableSpeed>& pockets) {
  std::erase_if(pockets, [&](StableSpeed& p) {
    double apart = std::numeric_limits<double>::infinity();
    for (const StableSpeed& o : others)
      apart = std::min(apart, std::abs(o.spindle_speed_rpm - p.spindle_speed_rpm));
    p.uncertainty_rpm = std::hypot(p.uncertainty_rpm, apart);
    return apart > p.spindle_speed_rpm / (4 * (p.waves + 1));
  });
}

/// Frequency of the ridge from the fraction and the lobe it must be in.
void name_frequencies(const Answer& answer, const ChatterMode& mode, int teeth,
                      StableSpeeds& result) {
  for (const std::size_t c : answer.used) {
    ChatterRidge& r = result.ridge[c];
    const double floor = 0.01 * percentile(r.power_Nm2, 0.95);
    for (std::size_t i = 0; i < r.t_s.size(); ++i) {
      if (r.power_Nm2[i] < floor) continue;
      const double period = 60 / (teeth * r.spindle_speed_rpm[i]);
      const ToothChatter here{period, answer.chatter[c].ridge_fraction[i], 0, 0, 0};
      r.frequency_hz[i] =
          (waves_of(here, chatter_frequency(mode, here.fraction)) + here.fraction) / period;
    }
  }
}

/// What an answer says of its ramps, in the time of their records.
void put_ramps(const Answer& answer, bool found, const std::vector<Ramp>& ramps,
               StableSpeeds& result) {
  for (std::size_t i = 0; i < ramps.size(); ++i) {
    const ChatterOfCut& c = answer.chatter[i];
    RampInCut where = ramps[i].where;
    where.fastest_rpm = c.fastest_rpm;
    where.slowest_rpm = c.slowest_rpm;
    where.chatter_share = c.share;
    result.ramps.push_back(where);
    result.minima.push_back(c.minima);
    result.ridge.push_back(c.ridge);
    for (PowerMinimum& m : result.minima.back()) m.t_s += where.from_s;
    for (double& t : result.ridge.back().t_s) t += where.from_s;
    result.ridge.back().frequency_hz.assign(c.ridge.t_s.size(),
                                            std::numeric_limits<double>::quiet_NaN());
  }
  for (const std::size_t r : answer.used) result.ramps[r].used = found;
  result.chatter_share = answer.share;
}

/// Mean square of the noise that rounding to whole counts leaves in a view.
double noise_of_counts(const CuttingTorqueTrace& cut, const TorqueView& view) {
  constexpr int kLines = 400;
  double sum = 0;
  for (int i = 0; i < kLines; ++i) {
    const double turn = kPi * (i + 0.5) / kLines;  // from sample to sample
    const double hz = turn / kTwoPi * cut.sample_rate_hz;
    const double pass = view.cutoff_hz > 0 ? std::exp2(-std::pow(hz / view.cutoff_hz, 2)) : 1;
    sum += std::pow(2 * std::sin(turn / 2), 4) * pass / kLines;
  }
  return sum * cut.count_torque_Nm * cut.count_torque_Nm / 12;
}

/// Why too little chatter was seen: whether it could have been, in the view with the least noise.
void say_what_could_be_seen(const Answer& answer, const std::vector<Ramp>& ramps,
                            double cutting_torque_Nm, double air_Nm2, StableSpeeds& result) {
  const auto best = std::max_element(
      answer.chatter.begin(), answer.chatter.end(),
      [](const ChatterOfCut& a, const ChatterOfCut& b) { return a.share < b.share; });
  const RampInCut& where = result.ramps[static_cast<std::size_t>(best - answer.chatter.begin())];
  const double counts_Nm2 = noise_of_counts(
      ramps[static_cast<std::size_t>(best - answer.chatter.begin())].cut, answer.view);
  // What the fit leaves in the cut may be chatter itself; in the air it is noise.
  const double noise = std::max(air_Nm2 > 0 ? air_Nm2 : best->noise_Nm2, counts_Nm2);
  result.visible_torque_Nm = std::sqrt(2 * kSeenOverNoise * noise);
  double expected = kChatterOfCut * cutting_torque_Nm;  // amplitude in the band
  // Where some is seen, its own height tells how weak the rest may be.
  const double strongest_Nm = std::sqrt(2 * best->strongest_Nm2);
  const bool some = best->share >= kSomeShare && best->share < kChatteringShare &&
                    strongest_Nm > result.visible_torque_Nm;
  if (some) expected = std::min(expected, kWeakChatter * strongest_Nm);
  const bool hidden = !(result.visible_torque_Nm < expected);
  if (!hidden && !(std::sqrt(2 * kSeenOverNoise * best->noise_Nm2) < expected)) {
    result.verdict = StableSpeedVerdict::unclear;
    result.sentence =
        "the torque in the cut changes from revolution to revolution far more than in the air, but "
        "not as chatter of one natural frequency does: use a wider ramp, a slower or a steadier "
        "one";
    return;
  }
  char line[500];
  result.verdict = hidden ? StableSpeedVerdict::hidden : StableSpeedVerdict::insufficient_chatter;
  const double from = best->rate_rpm_per_s < 0 ? where.fastest_rpm : where.slowest_rpm;
  const double to = best->rate_rpm_per_s < 0 ? where.slowest_rpm : where.fastest_rpm;
  if (hidden && !some)
    std::snprintf(line, sizeof line,
                  "noise hides the chatter, if there is any, from %.0f to %.0f rpm", from, to);
  else
    std::snprintf(line, sizeof line,
                  "%s: it stands out during %.0f %% of the ramp from %.0f to %.0f rpm",
                  hidden ? "noise hides chatter of this cut" : "insufficient chatter",
                  100 * result.chatter_share, from, to);
  result.sentence = line;
  std::snprintf(line, sizeof line,
                "; chatter of %.2g Nm or more below %.0f Hz would have been seen",
                result.visible_torque_Nm, result.seen_below_hz);
  result.sentence += line;
  if (!hidden) {
    std::snprintf(line, sizeof line,
                  ", and a cut of %.2g Nm that chatters has about %.2g Nm there: a deeper or wider "
                  "cut chatters at more speeds",
                  cutting_torque_Nm, expected);
    result.sentence += line;
    return;
  }
  if (!(cutting_torque_Nm > 0)) {
    result.sentence +=
        ", and how much this cut would have is not known: give [tool] and [cut] of the machine "
        "file";
    return;
  }
  std::snprintf(line, sizeof line,
                ", and a cut of %.2g Nm that chatters has only about %.2g Nm there",
                cutting_torque_Nm, expected);
  result.sentence += line;
  if (counts_Nm2 > 0.25 * noise) {
    result.counts_factor = result.visible_torque_Nm / expected;
    std::snprintf(line, sizeof line,
                  ": it takes %.2g times as many encoder counts a revolution, or a cut of %.2g Nm",
                  result.counts_factor, cutting_torque_Nm * result.counts_factor);
    result.sentence += line;
  } else {
    result.sentence +=
        ": the noise is not that of the encoder's counts; record angle and current "
        "at the servo rate";
  }
}

void say_unclear(StableSpeeds& result) {
  result.verdict = StableSpeedVerdict::unclear;
  result.sentence =
      "there is chatter, but no single natural frequency explains it; the minima of its power "
      "are given as they are: use a wider ramp or a slower one";
}

}  // namespace

Expected<StableSpeeds> identify_stable_speeds(const CuttingTorqueTrace& cut,
                                              const StableSpeedOptions& options) {
  return identify_stable_speeds(std::span(&cut, 1), options);
}

Expected<StableSpeeds> identify_stable_speeds(std::span<const CuttingTorqueTrace> records,
                                              const StableSpeedOptions& options) {
  if (records.empty()) return usage_error("stable speeds need at least one cut");
  std::vector<Ramp> ramps;
  double highest_hz = 0, fastest = 0, cutting_torque_Nm = 0;
  double mean_torque_Nm = 0;
  bool cut_stands_out = false, teeth_stand_out = false;
  std::optional<Error> too_short;
  std::vector<std::pair<std::size_t, std::vector<RampSpan>>> air;  // of each record
  for (std::size_t r = 0; r < records.size(); ++r) {
    if (auto ok = check_cut(records[r], options); !ok) return ok.error();
    const RampsOfRecord found = ramps_in_cut(records[r], options.teeth);
    for (const RampSpan& span : found.ramps) {
      Ramp ramp = ramp_of(records[r], r, span);
      auto ok = check_ramp(ramp.cut, options);
      if (ok)
        ramps.push_back(std::move(ramp));
      else if (!too_short)
        too_short = ok.error();
    }
    if (found.cut_stands_out && !found.ramps.empty()) {
      cut_stands_out = true;
      air.push_back({r, found.air});
      cutting_torque_Nm = std::max(cutting_torque_Nm, found.cutting_torque_Nm);
    }
    highest_hz = std::max(highest_hz, records[r].sample_rate_hz / 2);
  }
  if (ramps.empty() && too_short) return *too_short;
  if (ramps.empty())
    return data_error(
        "no ramp in a cut: nowhere does the spindle speed change by 10 % or more while 64 teeth or "
        "more cut; record one cut while the speed override falls steadily over the speeds of "
        "interest");
  StableSpeeds result;
  for (const Ramp& ramp : ramps)
    for (const double v : ramp.cut.spindle_speed_rad_s) fastest = std::max(fastest, std::abs(v));

  std::vector<bool> leaves_work(ramps.size(), true);
  std::vector<Answer> all;
  const std::vector<TorqueView> views = views_of(ramps, options.teeth * fastest / kTwoPi);
  for (const TorqueView& view : views) {
    if (options.progress)
      options.progress(static_cast<double>(all.size()) / static_cast<double>(views.size()));
    auto answer = look(ramps, options, view, highest_hz, leaves_work);
    if (!answer) return answer.error();
    for (const ChatterOfCut& c : answer->chatter)
      if (!view.inertia_alone && c.forced_Nm2 > kTeethStandOut * c.noise_Nm2) {
        teeth_stand_out = true;
        mean_torque_Nm = std::max(mean_torque_Nm, std::abs(c.mean_Nm));
      }
    all.push_back(std::move(*answer));
  }
  const std::vector<ChatterMode> modes = likely_modes(all);
  const Answer& narrowest = all.back();
  double air_Nm2 = 0;
  for (const auto& [r, spans] : air)
    air_Nm2 = std::max(air_Nm2, noise_in_air(torque_in(records[r], narrowest.view), spans));
  std::vector<Answer> answers;
  if (!modes.empty()) answers = explained(all, modes.front(), leaves_work);
  const auto most_chatter = [](const Answer& a, const Answer& b) { return a.share < b.share; };
  const Answer best = answers.empty()
                          ? *std::max_element(all.begin(), all.end(), most_chatter)
                          : *std::max_element(answers.begin(), answers.end(), most_chatter);
  put_ramps(best, !answers.empty(), ramps, result);
  result.seen_below_hz = narrowest.view.cutoff_hz;
  if (best.share < kChatteringShare) {
    // Without air to compare with: teeth that stand out are those of the cut.
    if (!cut_stands_out)
      cutting_torque_Nm = teeth_stand_out ? mean_torque_Nm : options.expected_torque_Nm;
    say_what_could_be_seen(narrowest, ramps, cutting_torque_Nm, air_Nm2, result);
    for (auto& minima : result.minima) minima.clear();
  } else if (answers.empty()) {
    // What stands out where nothing could have been seen is noise.
    if (!cut_stands_out)
      cutting_torque_Nm = teeth_stand_out ? mean_torque_Nm : options.expected_torque_Nm;
    say_what_could_be_seen(narrowest, ramps, cutting_torque_Nm, air_Nm2, result);
    if (result.verdict == StableSpeedVerdict::hidden) {
      for (auto& minima : result.minima) minima.clear();
      return result;
    }
    say_unclear(result);
  } else {
    result.verdict = StableSpeedVerdict::found;
    // A torque without counts: the widest view changes it least, and no rounding is averaged out.
    if (ramps.front().cut.inertia_torque_Nm.empty()) answers.resize(1);
    const SpeedInterval range = find_pockets(answers, options, result);
    std::vector<std::vector<Answer>> rivals;
    for (std::size_t i = 1; i < modes.size(); ++i)
      rivals.push_back(explained(all, modes[i], leaves_work));
    for (std::vector<Answer>& rival : rivals) {
      if (rival.empty()) continue;
      if (ramps.front().cut.inertia_torque_Nm.empty()) rival.resize(1);
      StableSpeeds other;
      find_pockets(rival, options, other);
      keep_common(other.pockets, result.pockets);
    }
    if (result.pockets.empty()) {
      say_unclear(result);
      return result;
    }
    result.sentence =
        text("%.0f stable speeds between %.0f and %.0f rpm",
             static_cast<double>(result.pockets.size()), range.from_rpm, range.to_rpm);
    match_minima(result);
    name_frequencies(best, modes.front(), options.teeth, result);
  }
  return result;
}

}  // namespace servosense
