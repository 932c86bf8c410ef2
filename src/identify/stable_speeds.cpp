#include "servosense/identify/stable_speeds.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <cstdio>
#include <optional>
#include <set>

#include "servosense/core/units.hpp"
#include "stable_speeds_ridge.hpp"

namespace servosense {
namespace {

using Complex = std::complex<double>;

struct Mode {
  double frequency_hz = 0;
  double damping = 0;
  double phase_error_rad = 0;  // median
  double misfit = 0;           // of the lobe numbers, see fit_from()
};

/// Frequency over natural frequency where w^2 - wn^2 = 2 zeta wn w `detuning`.
double frequency_ratio(double damping, double detuning) {
  const double x = damping * detuning;
  return x + std::sqrt(1 + x * x);
}

/// Frequency of chatter that leaves the fraction u, step 3 of the header with g = 0.
double chatter_frequency(const Mode& mode, double fraction) {
  const double slope = 1 / std::tan(kPi * (fraction - 0.5));
  return mode.frequency_hz * frequency_ratio(mode.damping, std::clamp(slope, -5.0, 5.0));
}

double waves_of(const ToothChatter& c, double frequency_hz) {
  return std::max(0.0, std::round(frequency_hz * c.period_s - c.fraction));
}

/// Least squares of the sine of the phase error; frequencies in units of `scale_hz`. `older` is the
/// share of the wave under each tooth that the last tooth but one left.
std::optional<Mode> fit(const std::vector<ToothChatter>& chatter, const std::vector<double>& waves,
                        const std::vector<double>& older, double scale_hz) {
  const double unit = kTwoPi * scale_hz;
  double a = 0.04, b = 1;  // 2 zeta wn, wn^2
  std::vector<double> error(chatter.size());
  for (int pass = 0; pass < 8; ++pass) {
    double aa = 0, ab = 0, bb = 0, ay = 0, by = 0;
    for (std::size_t i = 0; i < chatter.size(); ++i) {
      const ToothChatter& c = chatter[i];
      const Complex s = Complex(c.growth, kTwoPi * (waves[i] + c.fraction)) / (c.period_s * unit);
      // The wave left by the tooth before counts from half a period ago.
      const Complex back = std::polar(std::exp(-c.growth), -kTwoPi * (c.fraction - c.fraction_lag));
      const Complex chip = std::conj(1.0 - back * (1 - older[i] + older[i] * back));
      const double weight = 1 / (std::abs(s * s + a * s + b) * std::abs(chip));
      if (!std::isfinite(weight)) return std::nullopt;
      const double x = weight * (s * chip).imag(), y = weight * chip.imag();
      const double z = -weight * (s * s * chip).imag();
      aa += x * x, ab += x * y, bb += y * y, ay += x * z, by += y * z;
      error[i] = std::abs(a * x + b * y - z);
    }
    const double determinant = aa * bb - ab * ab;
    if (!(determinant > 1e-12 * aa * bb)) return std::nullopt;
    a = (ay * bb - by * ab) / determinant;
    b = (by * aa - ay * ab) / determinant;
    if (!(a > 0) || !(b > 0)) return std::nullopt;
  }
  const auto middle = error.begin() + static_cast<std::ptrdiff_t>(error.size() / 2);
  std::nth_element(error.begin(), middle, error.end());
  Mode mode;
  mode.frequency_hz = scale_hz * std::sqrt(b);
  mode.damping = a / (2 * std::sqrt(b));
  mode.phase_error_rad = std::asin(std::min(1.0, *middle));
  return mode;
}

double strongest_power(const std::vector<ToothChatter>& chatter) {
  std::vector<double> power;
  for (const ToothChatter& c : chatter) power.push_back(c.power_Nm2);
  std::sort(power.begin(), power.end());
  return power[power.size() * 95 / 100];
}

/// Fits a mode to the chatter, starting from a guess of its frequency. Where chatter is strongest,
/// the tool misses so much of the surface that the share `older` is that of the last tooth but one;
/// elsewhere it is smaller as the amplitude is.
std::optional<Mode> fit_from(const std::vector<ToothChatter>& chatter, double guess_hz,
                             double older_share = 0) {
  std::vector<double> waves(chatter.size()), older(chatter.size());
  const double strongest = strongest_power(chatter);
  for (std::size_t i = 0; i < chatter.size(); ++i) {
    waves[i] = waves_of(chatter[i], guess_hz);
    older[i] = older_share * std::sqrt(std::min(1.0, chatter[i].power_Nm2 / strongest));
  }
  std::optional<Mode> mode;
  for (int pass = 0; pass < 6; ++pass) {
    mode = fit(chatter, waves, older, guess_hz);
    // Chatter of one mode stays within a tenth or so of it.
    if (!mode || mode->damping > 0.2 || mode->damping < 1e-3) return std::nullopt;
    bool same = true;
    for (std::size_t i = 0; i < chatter.size(); ++i) {
      const double w = waves_of(chatter[i], chatter_frequency(*mode, chatter[i].fraction));
      same = same && w == waves[i];
      waves[i] = w;
    }
    if (same) break;
  }
  std::vector<double> distance;
  for (const ToothChatter& c : chatter) {
    const double w = chatter_frequency(*mode, c.fraction) * c.period_s - c.fraction;
    distance.push_back(std::abs(w - std::round(w)));
  }
  const auto middle = distance.begin() + static_cast<std::ptrdiff_t>(distance.size() / 2);
  std::nth_element(distance.begin(), middle, distance.end());
  // A wrong lobe number shows in both: half the frequency leaves whole waves too, but not the
  // phase, and a high one the phase, but not whole waves.
  mode->misfit = std::sqrt(*middle * mode->phase_error_rad);
  // One lobe alone does not tell its number.
  std::set<double> lobes;
  for (const double w : waves)
    if (static_cast<double>(std::count(waves.begin(), waves.end(), w)) >
        0.05 * static_cast<double>(waves.size()))
      lobes.insert(w);
  return lobes.size() >= 2 ? mode : std::nullopt;
}

/// The mode and share of older waves that leave the least phase error, near a mode without them.
std::optional<Mode> fit_with_older_waves(const std::vector<ToothChatter>& chatter,
                                         double natural_frequency_hz, int most_percent) {
  std::optional<Mode> best;
  for (int percent = 0; percent <= most_percent; percent += 2)
    if (const auto mode = fit_from(chatter, natural_frequency_hz, 0.01 * percent);
        mode && (!best || mode->phase_error_rad < best->phase_error_rad))
      best = mode;
  return best;
}

struct Search {
  std::optional<Mode> best;
  double rival_misfit = std::numeric_limits<double>::infinity();  // of another lobe number
};

Search search_mode(const std::vector<ToothChatter>& chatter, double highest_hz) {
  double rate = 0;
  for (const ToothChatter& c : chatter) rate += 1 / c.period_s;
  rate /= static_cast<double>(chatter.size());
  std::vector<Mode> found;
  for (double guess = rate; guess < highest_hz; guess += rate / 4)
    if (auto mode = fit_from(chatter, guess)) found.push_back(*mode);
  Search result;
  for (const Mode& m : found)
    if (!result.best || m.misfit < result.best->misfit) result.best = m;
  for (const Mode& m : found)
    if (std::abs(m.frequency_hz - result.best->frequency_hz) > rate / 3)
      result.rival_misfit = std::min(result.rival_misfit, m.misfit);
  return result;
}

/// Strong chatter, the fraction of which noise does not touch: it tells the lobes best.
std::vector<ToothChatter> strong(const std::vector<ToothChatter>& chatter) {
  if (chatter.empty()) return {};
  const double strongest = strongest_power(chatter);
  std::vector<ToothChatter> result;
  for (const ToothChatter& c : chatter)
    if (c.power_Nm2 > 0.05 * strongest) result.push_back(c);
  return result;
}

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
    for (const auto& cut : result.minima)
      for (const PowerMinimum& m : cut)
        if (m.accepted && m.spindle_speed_rpm > here - gap &&
            m.spindle_speed_rpm < here + gap / 3 &&
            !(std::abs(m.spindle_speed_rpm - here) >= std::abs(pocket.minimum_rpm - here)))
          pocket.minimum_rpm = m.spindle_speed_rpm;
  }
}

}  // namespace

double single_mode_pocket_rpm(double natural_frequency_hz, double damping_ratio, int teeth,
                              int waves, bool above) {
  const double sign = above ? 1 : -1;
  auto ratio = [&](double x) { return frequency_ratio(damping_ratio, sign * x); };
  auto real_part = [&](double x) { return x / ((1 + x * x) * ratio(x)); };  // of lambda, but scale
  auto root = [](double low, double high, auto&& rising) {
    for (int i = 0; i < 100; ++i) {
      const double middle = (low + high) / 2;
      (rising(middle) < 0 ? low : high) = middle;
    }
    return (low + high) / 2;
  };
  // From the detuning of the chatter near the natural frequency to that of the other lobe, and to
  // the natural periods per tooth passing at which both come to the same limit.
  auto periods = [&](double near) {
    const double far = root(1, 3 / near, [&](double x) { return real_part(near) - real_part(x); });
    return (1 - (std::atan(1 / near) - std::atan(1 / far)) / kPi) /
           std::abs(ratio(far) - ratio(near));
  };
  const double near = root(1e-6, 1 - 2 * damping_ratio, [&](double x) {
    return periods(x) * ratio(x) + sign * std::atan(x) / kPi - waves;
  });
  return 60 * natural_frequency_hz / (teeth * periods(near));
}

Expected<StableSpeeds> identify_stable_speeds(const CuttingTorqueTrace& cut,
                                              const StableSpeedOptions& options) {
  return identify_stable_speeds(std::span(&cut, 1), options);
}

Expected<StableSpeeds> identify_stable_speeds(std::span<const CuttingTorqueTrace> cuts,
                                              const StableSpeedOptions& options) {
  if (cuts.empty()) return usage_error("stable speeds need at least one cut");
  std::vector<ChatterOfCut> all;
  double highest = 0;
  for (const CuttingTorqueTrace& cut : cuts) {
    auto chatter = chatter_of(cut, options);
    if (!chatter) return chatter.error();
    all.push_back(std::move(*chatter));
    highest = std::max(highest, cut.sample_rate_hz / 2);
  }
  StableSpeeds result;
  result.chatter_share = 1;
  bool accelerating = false;
  std::vector<ToothChatter> joint;
  for (ChatterOfCut& c : all) {
    result.minima.push_back(c.minima);
    c.ridge.frequency_hz.assign(c.ridge.t_s.size(), std::numeric_limits<double>::quiet_NaN());
    result.ridge.push_back(c.ridge);
    result.chatter_share = std::min(result.chatter_share, c.share);
    accelerating = accelerating || c.rate_rpm_per_s > 0;
    joint.insert(joint.end(), c.chatter.begin(), c.chatter.end());
  }
  if (result.chatter_share < kChatteringShare) {
    result.verdict = StableSpeedVerdict::insufficient_chatter;
    result.sentence = text(
        "insufficient chatter: it stands out during %.0f %% of the ramp only; cut deeper or "
        "wider, so that it chatters at nearly every speed",
        100 * result.chatter_share);
    for (auto& cut : result.minima) cut.clear();
    return result;
  }
  if (accelerating) {
    result.verdict = StableSpeedVerdict::accelerating;
    result.sentence =
        "the spindle speeds up: chatter builds up slowly from lobe to lobe then and its jumps are "
        "weak; repeat the cut with the speed falling";
    return result;
  }
  // With the tooth angle of both branches in one fit, every cut must chatter on the same side.
  bool one_side = true;
  for (const ChatterOfCut& c : all) one_side = one_side && c.above == all.front().above;
  const std::vector<ToothChatter> clear = strong(joint);
  const Search search = clear.size() < 16 || !one_side ? Search{} : search_mode(clear, highest);
  // Drawn by lot, lobe numbers are a quarter of a wave off and phases 0.8 rad.
  const bool plain =
      search.best && search.best->misfit < 0.15 && search.rival_misfit > 1.3 * search.best->misfit;
  std::vector<Mode> modes;
  if (plain)
    for (const ChatterOfCut& c : all)
      if (auto mode = fit_with_older_waves(strong(c.chatter), search.best->frequency_hz,
                                           c.leaves_work ? 60 : 0);
          mode && std::abs(mode->frequency_hz / search.best->frequency_hz - 1) < 0.05)
        modes.push_back(*mode);
  if (modes.size() != all.size()) {
    result.verdict = StableSpeedVerdict::unclear;
    result.sentence =
        "there is chatter, but no single natural frequency explains it; the minima of its power "
        "are given as they are: use a wider ramp or a slower one";
    return result;
  }

  result.verdict = StableSpeedVerdict::found;
  const auto mean = [&](double Mode::* value) {
    double sum = 0;
    for (const Mode& m : modes) sum += m.*value;
    return sum / static_cast<double>(modes.size());
  };
  result.natural_frequency_hz = mean(&Mode::frequency_hz);
  result.damping_ratio = mean(&Mode::damping);
  result.phase_error_rad = mean(&Mode::phase_error_rad);
  double from = 0, to = std::numeric_limits<double>::infinity();
  for (const ChatterOfCut& c : all) {
    // A pocket within its own error of an end may well lie outside, and one of its lobes does.
    from = std::max(from, 1.01 * c.slowest_rpm);
    to = std::min(to, 0.99 * c.fastest_rpm);
  }
  const bool above = all.front().above;
  for (int waves = 1; waves < 1000; ++waves) {
    StableSpeed pocket;
    double low = std::numeric_limits<double>::infinity(), high = 0;
    for (const Mode& m : modes) {
      const double speed =
          single_mode_pocket_rpm(m.frequency_hz, m.damping, options.teeth, waves, above);
      pocket.spindle_speed_rpm += speed / static_cast<double>(modes.size());
      low = std::min(low, speed);
      high = std::max(high, speed);
    }
    pocket.waves = waves;
    pocket.spread_rpm = high - low;
    if (pocket.spindle_speed_rpm < from) break;
    if (pocket.spindle_speed_rpm <= to) result.pockets.insert(result.pockets.begin(), pocket);
  }
  match_minima(result);
  for (std::size_t c = 0; c < all.size(); ++c) {
    ChatterRidge& r = result.ridge[c];
    std::vector<double> sorted = r.power_Nm2;
    std::sort(sorted.begin(), sorted.end());
    const double floor = 0.01 * sorted[sorted.size() * 95 / 100];
    for (std::size_t i = 0; i < r.t_s.size(); ++i) {
      if (r.power_Nm2[i] < floor) continue;
      const double period = 60 / (options.teeth * r.spindle_speed_rpm[i]);
      const ToothChatter here{period, all[c].ridge_fraction[i], 0, 0, 0};
      r.frequency_hz[i] =
          (waves_of(here, chatter_frequency(*search.best, here.fraction)) + here.fraction) / period;
    }
  }
  result.sentence = text("%.0f stable speeds between %.0f and %.0f rpm",
                         static_cast<double>(result.pockets.size()), from, to);
  return result;
}

}  // namespace servosense
