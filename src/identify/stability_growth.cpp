#include <algorithm>
#include <cmath>
#include <complex>
#include <utility>

#include "servosense/identify/growth_ratio.hpp"
#include "stability_loop.hpp"

namespace servosense {
namespace {

using Complex = std::complex<double>;

/// Angle within half a turn of `near`.
double unwrapped(double angle, double near) {
  return angle - kTwoPi * std::round((angle - near) / kTwoPi);
}

/// mu exp(j w T) along one eigenvalue, at one depth: a curve over w on which every speed finds its
/// solutions where the angle equals w T.
struct Locus {
  std::vector<Complex> ratio;
  std::vector<double> angle_rad;  ///< continuous
};

/// Smallest depth at which lambda = c at some w: there mu is infinite for want of a chip.
double depth_of_first_pole(const OrientedReceptance& loop, double depth_scale_m) {
  const auto& w = loop.grid_rad_s();
  const auto& lambda = loop.on_grid();
  double largest = 0;
  for (std::size_t i = 1; i < w.size(); ++i)
    for (std::size_t branch = 0; branch < 2; ++branch) {
      const Complex left = lambda[i - 1][branch];
      const Complex right = lambda[i][branch];
      if ((left.imag() < 0) == (right.imag() < 0)) continue;
      if (std::max(left.real(), right.real()) <= largest) continue;
      const auto value = [&](double x) {
        const double share = (x - w[i - 1]) / (w[i] - w[i - 1]);
        return loop.near(x, (1 - share) * left + share * right);
      };
      const double at =
          root_between([&](double x) { return value(x).imag(); }, w[i - 1], w[i], 1e-12);
      largest = std::max(largest, value(at).real());
    }
  return depth_scale_m / largest;
}

/// A crossing of the locus between two grid points.
struct Candidate {
  std::size_t right;  ///< grid point after it
  double turns;       ///< whole turns by which w T is ahead of the angle
  double estimate;    ///< mu there, by interpolation
};

constexpr double kMostLobes = 4;  // looked at between two points of the grid: a limit of cost

}  // namespace

Expected<GrowthMap> growth_map(const Structure& structure, const MillingTool& tool,
                               const MillingCut& cut, std::span<const double> spindle_speed_rpm,
                               std::span<const double> axial_depth_m) {
  if (auto error = refuse_cut(tool, cut)) return *error;
  if (auto error = refuse_beyond_zeroth_order(tool)) return *error;
  if (auto error = refuse_structure(structure)) return *error;
  if (auto error = refuse_axis(spindle_speed_rpm, "spindle speed", "rpm")) return *error;
  if (auto error = refuse_axis(axial_depth_m, "axial depth", "m")) return *error;

  const OrientedReceptance loop(
      engagement_integral(engagement_of(tool, cut), tool.force.radial_ratio), structure);
  const auto& w = loop.grid_rad_s();
  const auto& lambda = loop.on_grid();

  GrowthMap map;
  map.spindle_speed_rpm.assign(spindle_speed_rpm.begin(), spindle_speed_rpm.end());
  map.axial_depth_m.assign(axial_depth_m.begin(), axial_depth_m.end());
  map.amplitude_ratio.assign(spindle_speed_rpm.size() * axial_depth_m.size(), 0);

  const double depth_scale =  // over lambda, the depth at which c = lambda
      2 * kTwoPi / (tool.teeth * tool.force.tangential_coefficient_N_per_m2);
  map.valid_to_m = depth_of_first_pole(loop, depth_scale);

  std::vector<Candidate> candidates;
  for (std::size_t d = 0; d < axial_depth_m.size(); ++d) {
    const double c = depth_scale / axial_depth_m[d];
    for (std::size_t branch = 0; branch < 2; ++branch) {
      Locus locus;
      for (std::size_t i = 0; i < w.size(); ++i) {
        const Complex ratio = lambda[i][branch] / (lambda[i][branch] - c);
        const double before = i == 0 ? 0 : locus.angle_rad.back();
        locus.ratio.push_back(ratio);
        locus.angle_rad.push_back(unwrapped(std::arg(ratio), before));
      }
      for (std::size_t s = 0; s < spindle_speed_rpm.size(); ++s) {
        const double period = 60 / (tool.teeth * spindle_speed_rpm[s]);
        double& best = map.amplitude_ratio[s * axial_depth_m.size() + d];
        candidates.clear();
        double promise = 0;
        double right_turns = (w[0] * period - locus.angle_rad[0]) / kTwoPi;
        for (std::size_t i = 1; i < w.size(); ++i) {
          const double left_turns = right_turns;
          right_turns = (w[i] * period - locus.angle_rad[i]) / kTwoPi;
          const double first = std::ceil(std::min(left_turns, right_turns));
          const double last = std::floor(std::max(left_turns, right_turns));
          // Of very many lobes between two points of the grid some are as good as all.
          const double step = std::max(1.0, std::floor((last - first) / kMostLobes));
          for (double k = first; k <= last; k += step) {
            const double share =
                left_turns == right_turns ? 0.5 : (k - left_turns) / (right_turns - left_turns);
            const Complex value = (1 - share) * lambda[i - 1][branch] + share * lambda[i][branch];
            const double estimate = std::abs(value / (value - c));
            candidates.push_back({i, k, estimate});
            promise = std::max(promise, estimate);
          }
        }
        for (const Candidate& candidate : candidates) {
          // On so fine a grid the estimate is good to a few percent.
          if (candidate.estimate < 0.8 * std::max(promise, best)) continue;
          const std::size_t i = candidate.right;
          const auto ratio_at = [&](double x) {
            const double share = (x - w[i - 1]) / (w[i] - w[i - 1]);
            const Complex value =
                loop.near(x, (1 - share) * lambda[i - 1][branch] + share * lambda[i][branch]);
            return value / (value - c);
          };
          const auto mismatch = [&](double x) {
            const double share = (x - w[i - 1]) / (w[i] - w[i - 1]);
            const double expected =
                (1 - share) * locus.angle_rad[i - 1] + share * locus.angle_rad[i];
            return x * period - unwrapped(std::arg(ratio_at(x)), expected) -
                   kTwoPi * candidate.turns;
          };
          best = std::max(best, std::abs(ratio_at(root_between(mismatch, w[i - 1], w[i], 1e-12))));
        }
      }
    }
  }
  return map;
}

}  // namespace servosense
