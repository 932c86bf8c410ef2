// What a cut may lack, and from where each of it is fitted.
#include <algorithm>
#include <array>
#include <cmath>

#include "reconcile/cut/fit.hpp"
#include "servosense/core/units.hpp"

namespace servosense::reconcile {

using enum Unknown::Kind;

namespace {}  // namespace

Family CutFitter::offset() {
  constexpr double kMost_N = 1e6;
  return {
      nullptr,  {{offset_x, 0, -kMost_N, kMost_N, 1e-2}, {offset_y, 0, -kMost_N, kMost_N, 1e-2}},
      {{0, 0}}, false,
      0,        {}};
}

std::vector<Family> CutFitter::families(const CutFit& base) const {
  std::vector<Family> all;
  const MillingTool& tool = given_.tool;
  const auto teeth = static_cast<std::size_t>(tool.teeth);
  const auto has = [&](Unknown::Kind kind) {
    return std::any_of(nuisances_.begin(), nuisances_.end(),
                       [&](const Unknown& u) { return u.kind == kind; });
  };
  if (!given_.edges) all.push_back({&EdgeForceEffect::info, {}, {}, true, 0, {}});
  if (!has(exponent))
    all.push_back(
        {&SizeEffect::info, {{exponent, 0, -0.5, 0.9, 1e-3}}, {{0.05}, {0.25}}, false, 0, {}});
  if (teeth > 1 && !has(throw_x)) {
    Family f{&RunoutEffect::info, {{throw_x, 0, -3, 3, 1e-3}}, {}, false, 0, {}};
    if (teeth > 2) f.unknowns.push_back({throw_y, 0, -3, 3, 1e-3});
    // Of two teeth it is one short tooth by half: from the same starts, so that both end alike.
    const std::array<double, 3> sizes =
        teeth == 2 ? std::array{0.05, 0.2, 0.5} : std::array{0.1, 0.3, 0.8};
    for (const double size : sizes)
      for (int k = 0; k < 8; ++k) {
        const double at = kTwoPi * k / 8;
        if (teeth > 2)
          f.starts.push_back({size * std::cos(at), size * std::sin(at)});
        else if (k % 4 == 0)
          f.starts.push_back({size * std::cos(at)});
      }
    all.push_back(std::move(f));
  }
  for (std::size_t j = 0; j < teeth && teeth > 1; ++j) {
    all.push_back({&MissingToothEffect::info,
                   {{broken, j, 0, 1, 1e-3}},
                   {{0.05}, {0.3}, {0.7}, {1}},
                   false,
                   j,
                   "missing-tooth"});
    all.push_back({&MissingToothEffect::info,
                   {{shorter, j, -2, 2.5 * static_cast<double>(teeth), 1e-3}},
                   {{0.1}, {0.4}, {1.0}},
                   false,
                   j,
                   "missing-tooth"});
  }
  if (teeth > 1) {
    Family f{&PitchErrorEffect::info, {}, {{}}, false, 0, {}};
    for (std::size_t j = 1; j < teeth; ++j) {
      const double most = criteria_.most_pitch_error * kTwoPi / static_cast<double>(teeth);
      f.unknowns.push_back({pitch, j, -most, most, 1e-3});
      f.starts[0].push_back(0);
    }
    for (std::size_t j = 1; j < teeth; ++j)
      for (const double off : {-0.05, 0.05}) {
        f.starts.push_back(f.starts[0]);
        f.starts.back()[j - 1] = off;
      }
    all.push_back(std::move(f));
  }
  {
    Family f{&HelixLagEffect::info, {{helix, 0, -5, 70, 1e-2}}, {}, false, 0, {}};
    for (const double part : {0.6, 0.8, 1.25, 1.6}) f.starts.push_back({part * tool.helix_deg});
    for (const double deg : {5.0, 20.0, 35.0, 50.0}) f.starts.push_back({deg});
    all.push_back(std::move(f));
  }
  if (forced_only()) all.push_back({&RegenerationEffect::info, {}, {}, false, 0, {}, true});
  // The speed of the tool is known where its modes are.
  if (!(given_.structure.x.empty() && given_.structure.y.empty()) &&
      tool.force.process_damping_N_per_m == 0)
    all.push_back({&ProcessDampingEffect::info,
                   {{damping, 0, -1, 10, 1e-3}},
                   {{0.05}, {0.3}, {1.5}},
                   false,
                   0,
                   {}});
  add_mode_starts(all, base);
  return all;
}

/// Resonances are narrow: a fine scan of the frequency by the first order of their effect.
void CutFitter::add_mode_starts(std::vector<Family>& all, const CutFit& base) const {
  double highest_hz = 1e300, lowest_hz = 1e300;
  for (const CutLevel& level : average_.levels) {
    if (!(level.samples_per_turn > 0)) continue;
    const double turn_hz = level.speed_rad_s / kTwoPi;
    const double samples = std::min(level.samples_per_turn, static_cast<double>(average_.bins));
    highest_hz = std::min(highest_hz, 0.45 * samples * turn_hz);
    lowest_hz = std::min(lowest_hz, 1.5 * turn_hz);
  }
  if (!(highest_hz > 2 * lowest_hz) || highest_hz > 1e200) return;
  constexpr double kRatio = 1.03;
  std::vector<double> frequencies;
  for (double f = lowest_hz; f < 1.4 * highest_hz; f *= kRatio) frequencies.push_back(f);

  struct Peak {
    double hz, damping, mass, loss;
  };
  const auto best_of = [](std::vector<Peak> peaks) {
    // The deepest, no two of them neighbours.
    std::stable_sort(peaks.begin(), peaks.end(),
                     [](const Peak& a, const Peak& b) { return a.loss < b.loss; });
    std::vector<Peak> kept;
    for (const Peak& p : peaks) {
      if (std::all_of(kept.begin(), kept.end(),
                      [&](const Peak& k) { return std::abs(std::log(k.hz / p.hz)) > 0.08; }))
        kept.push_back(p);
      if (kept.size() == 4) break;
    }
    return kept;
  };

  if (!given_.sensor) {
    // Each direction on its own: they ring at different frequencies.
    const auto bins = static_cast<Eigen::Index>(average_.bins);
    std::array<std::vector<Peak>, 2> peaks;
    for (const double hz : frequencies)
      for (const double damping : {0.04}) {
        CutState s = base.state;
        s.sensor = SensorMode{{hz, hz}, {damping, damping}};
        const std::vector<Eigen::VectorXd> with = forces(s);
        for (std::size_t axis = 0; axis < 2; ++axis) {
          double loss = 0;
          for (std::size_t l = 0; l < with.size(); ++l) {
            const Eigen::Index from = axis == 0 ? 0 : bins;
            loss += (weight_[l].array() * (mean_[l] - with[l]).array().square())
                        .segment(from, bins)
                        .sum();
          }
          peaks[axis].push_back({hz, damping, 0, loss});
        }
      }
    Family f{&SensorResonanceEffect::info, {}, {}, false, 0, {}};
    for (const std::size_t axis : {std::size_t{0}, std::size_t{1}}) {
      f.unknowns.push_back(
          {sensor_hz, axis, std::log(lowest_hz), std::log(kBeyondBand * highest_hz), 1e-4});
      f.unknowns.push_back({sensor_damping, axis, std::log(1e-3), std::log(0.9), 1e-3});
    }
    const std::vector<Peak> of_y = best_of(std::move(peaks[1]));
    for (const Peak& x : best_of(std::move(peaks[0])))
      for (const Peak& y : of_y)
        f.starts.push_back(
            {std::log(x.hz), std::log(x.damping), std::log(y.hz), std::log(y.damping)});
    all.push_back(std::move(f));
  }
  // A mode that cuts is remembered: none is added to some of which the file says that they are not.
  if (forced_only()) return;
  for (std::size_t axis = 0; axis < 2; ++axis) {
    std::vector<Peak> peaks;
    for (const double hz : frequencies)
      for (const double damping : {0.03}) {
        // A mode so heavy that its effect is small, scaled to what the residual asks for.
        const double light = std::abs(base.state.coefficients[0]) * given_.cut.axial_depth_m /
                             (kTwoPi * hz * kTwoPi * hz);
        const double heavy = 50 * light;
        CutState s = base.state;
        modes_along(s, axis).push_back({hz, damping, heavy});
        s.vibration_rounds = 1;
        const std::vector<Eigen::VectorXd> with = forces(s);
        double up = 0, down = 0;
        for (std::size_t l = 0; l < with.size(); ++l) {
          const Eigen::VectorXd d = with[l] - base.bins[l];
          const Eigen::VectorXd r = mean_[l] - base.bins[l];
          up += (weight_[l].array() * d.array() * r.array()).sum();
          down += (weight_[l].array() * d.array().square()).sum();
        }
        const double gain = down > 0 ? up / down : 0;
        if (!(gain > 0)) continue;
        peaks.push_back({hz, damping, std::max(heavy / gain, 0.5 * light), -up * gain});
      }
    Family f{&ExtraModeEffect::info,
             {{mode_hz, axis, std::log(lowest_hz), std::log(kBeyondBand * highest_hz), 1e-4},
              {mode_damping, axis, std::log(2e-3), std::log(0.7), 1e-3},
              {mode_mass, axis, std::log(1e-4), std::log(1e5), 1e-3}},
             {},
             false,
             axis,
             "extra-mode"};
    const std::vector<Peak> best = best_of(std::move(peaks));
    for (const Peak& p : best)
      f.starts.push_back({std::log(p.hz), std::log(p.damping), std::log(p.mass)});
    all.push_back(std::move(f));
  }
}

}  // namespace servosense::reconcile
