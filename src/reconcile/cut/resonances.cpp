// Where the fit of a resonance starts: narrow ones are found by a fine scan of the frequency, by
// the first order of their effect.
#include <algorithm>
#include <array>
#include <cmath>

#include "reconcile/cut/effects.hpp"
#include "servosense/core/units.hpp"

namespace servosense::reconcile {

using enum Unknown::Kind;

namespace {

constexpr double kRatio = 1.03;  // of a scan
constexpr double kMost_N = 1e6;  // of an offset

struct Resonance {
  double hz, damping, mass, loss;
};

/// The deepest, no two of them neighbours.
std::vector<Resonance> best_of(std::vector<Resonance> peaks) {
  std::stable_sort(peaks.begin(), peaks.end(),
                   [](const Resonance& a, const Resonance& b) { return a.loss < b.loss; });
  std::vector<Resonance> kept;
  for (const Resonance& p : peaks) {
    if (std::all_of(kept.begin(), kept.end(),
                    [&](const Resonance& k) { return std::abs(std::log(k.hz / p.hz)) > 0.08; }))
      kept.push_back(p);
    if (kept.size() == 4) break;
  }
  return kept;
}

}  // namespace

Family CutFitter::offset() {
  return {nullptr,
          {{offset_x, 0, -kMost_N, kMost_N, 1e-2}, {offset_y, 0, -kMost_N, kMost_N, 1e-2}},
          {{0, 0}}};
}

std::vector<Family> CutFitter::families(const CutFit& base) const {
  std::vector<Family> all;
  for (const CutEffect& effect : cut_effects()) effect.families(*this, base, all);
  return all;
}

/// Frequencies that the samples show; none where there are too few in a turn.
CutFitter::Scan CutFitter::scan() const {
  double highest_hz = 1e300, lowest_hz = 1e300;
  for (const CutLevel& level : average_.levels) {
    if (!(level.samples_per_turn > 0)) continue;
    const double turn_hz = level.speed_rad_s / kTwoPi;
    const double samples = std::min(level.samples_per_turn, static_cast<double>(average_.bins));
    highest_hz = std::min(highest_hz, 0.45 * samples * turn_hz);
    lowest_hz = std::min(lowest_hz, 1.5 * turn_hz);
  }
  Scan scan{lowest_hz, highest_hz, {}};
  if (!(highest_hz > 2 * lowest_hz) || highest_hz > 1e200) return scan;
  for (double f = lowest_hz; f < 1.4 * highest_hz; f *= kRatio) scan.frequencies_hz.push_back(f);
  return scan;
}

/// Each direction on its own: they ring at different frequencies.
void CutFitter::add_sensor_resonance(const CutFit& base, std::vector<Family>& all) const {
  constexpr double kDamping = 0.04;
  const Scan scanned = scan();
  if (given_.sensor || scanned.frequencies_hz.empty()) return;
  const auto bins = static_cast<Eigen::Index>(average_.bins);
  std::array<std::vector<Resonance>, 2> peaks;
  for (const double hz : scanned.frequencies_hz) {
    CutState s = base.state;
    s.sensor = SensorMode{{hz, hz}, {kDamping, kDamping}};
    const std::vector<Eigen::VectorXd> with = forces(s);
    for (std::size_t axis = 0; axis < 2; ++axis) {
      double loss = 0;
      for (std::size_t l = 0; l < with.size(); ++l) {
        const Eigen::Index from = axis == 0 ? 0 : bins;
        loss +=
            (weight_[l].array() * (mean_[l] - with[l]).array().square()).segment(from, bins).sum();
      }
      peaks[axis].push_back({hz, kDamping, 0, loss});
    }
  }
  Family f{&SensorResonanceEffect::info, {}, {}};
  for (const std::size_t axis : {std::size_t{0}, std::size_t{1}}) {
    f.unknowns.push_back({sensor_hz, axis, std::log(scanned.lowest_hz),
                          std::log(kBeyondBand * scanned.highest_hz), 1e-4});
    f.unknowns.push_back({sensor_damping, axis, std::log(1e-3), std::log(0.9), 1e-3});
  }
  const std::vector<Resonance> of_y = best_of(std::move(peaks[1]));
  for (const Resonance& x : best_of(std::move(peaks[0])))
    for (const Resonance& y : of_y)
      f.starts.push_back(
          {std::log(x.hz), std::log(x.damping), std::log(y.hz), std::log(y.damping)});
  all.push_back(std::move(f));
}

/// A mode that cuts is remembered: none is added to some of which the file says that they are not.
void CutFitter::add_modes(const CutFit& base, std::vector<Family>& all) const {
  constexpr double kDamping = 0.03;
  const Scan scanned = scan();
  if (forced_only() || scanned.frequencies_hz.empty()) return;
  for (std::size_t axis = 0; axis < 2; ++axis) {
    std::vector<Resonance> peaks;
    for (const double hz : scanned.frequencies_hz) {
      // A mode so heavy that its effect is small, scaled to what the residual asks for.
      const double light = std::abs(base.state.coefficients[0]) * given_.cut.axial_depth_m /
                           (kTwoPi * hz * kTwoPi * hz);
      const double heavy = 50 * light;
      CutState s = base.state;
      modes_along(s, axis).push_back({hz, kDamping, heavy});
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
      peaks.push_back({hz, kDamping, std::max(heavy / gain, 0.5 * light), -up * gain});
    }
    Family f{&ExtraModeEffect::info,
             {{mode_hz, axis, std::log(scanned.lowest_hz),
               std::log(kBeyondBand * scanned.highest_hz), 1e-4},
              {mode_damping, axis, std::log(2e-3), std::log(0.7), 1e-3},
              {mode_mass, axis, std::log(1e-4), std::log(1e5), 1e-3}},
             {},
             false,
             axis,
             "extra-mode"};
    const auto best = best_of(std::move(peaks));
    for (const Resonance& p : best)
      f.starts.push_back({std::log(p.hz), std::log(p.damping), std::log(p.mass)});
    all.push_back(std::move(f));
  }
}

}  // namespace servosense::reconcile
