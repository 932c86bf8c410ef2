// How far a stable cut deflects the tool: the periodic response of its modes to the teeth.
//
// In the periodic state u(t) = u(t - T), T the tooth period, so that vibration takes nothing from
// the chip and gives nothing to it: the force of an undisturbed tool, as a Fourier series of the
// tooth frequency, times the receptance. Mean deflection included. Equal pitch; run-out is left
// out. Force law without size effect, frame as model/milling.hpp.
#pragma once

#include <algorithm>
#include <cmath>
#include <complex>
#include <cstddef>
#include <vector>

#include "servosense/core/units.hpp"
#include "servosense/model/milling.hpp"
#include "servosense/model/structural_mode.hpp"

namespace servosense {

class ForcedDeflection {
 public:
  /// Speed and depth of `cut` above zero; its feed is not used.
  ForcedDeflection(const Structure& structure, const MillingTool& tool, const MillingCut& cut) {
    const double tooth_rad_s = rad_s_from_rpm(cut.spindle_speed_rpm) * tool.teeth;
    double fastest = tooth_rad_s;
    for (const auto* modes : {&structure.x, &structure.y})
      for (const StructuralMode& m : *modes)
        fastest = std::max(fastest, m.natural_frequency_rad_s());
    const auto lines = static_cast<std::size_t>(std::clamp(2 * fastest / tooth_rad_s, 8.0, 200.0));
    const std::size_t looks = 4 * lines;
    by_feed_.assign(looks, {});
    by_edge_.assign(looks, {});
    std::vector<Place> turn(looks);  // cosine and sine over the tooth period
    for (std::size_t i = 0; i < looks; ++i) {
      const double angle_rad = kTwoPi * static_cast<double>(i) / static_cast<double>(looks);
      turn[i] = {std::cos(angle_rad), std::sin(angle_rad)};
    }
    const std::vector<Complex> turned =
        means(engagement_of(tool, cut), lines * static_cast<std::size_t>(tool.teeth) + 3);
    for (std::size_t k = 0; k <= lines; ++k) {
      const double w = static_cast<double>(k) * tooth_rad_s;
      std::complex<double> gx = 0, gy = 0;
      for (const StructuralMode& m : structure.x) gx += m.receptance(w);
      for (const StructuralMode& m : structure.y) gy += m.receptance(w);
      const Line force = line(tool, cut, turned, static_cast<int>(k));
      const Pair feed{gx * force.feed.x, gy * force.feed.y},
          edge{gx * force.edge.x, gy * force.edge.y};
      std::size_t at = 0;
      for (std::size_t i = 0; i < looks; ++i) {
        const auto [c, s] = turn[at];
        by_feed_[i].x += feed.x.real() * c - feed.x.imag() * s;
        by_feed_[i].y += feed.y.real() * c - feed.y.imag() * s;
        by_edge_[i].x += edge.x.real() * c - edge.x.imag() * s;
        by_edge_[i].y += edge.y.real() * c - edge.y.imag() * s;
        at = (at + k) % looks;
      }
    }
  }

  /// Farthest that the tool tip is from where it is at rest [m].
  [[nodiscard]] double farthest_m(double feed_per_tooth_m) const {
    double most_m2 = 0;
    for (std::size_t i = 0; i < by_feed_.size(); ++i) {
      const double x = by_feed_[i].x * feed_per_tooth_m + by_edge_[i].x;
      const double y = by_feed_[i].y * feed_per_tooth_m + by_edge_[i].y;
      most_m2 = std::max(most_m2, x * x + y * y);
    }
    return std::sqrt(most_m2);
  }

 private:
  using Complex = std::complex<double>;
  struct Place {
    double x = 0, y = 0;
  };
  struct Pair {
    Complex x, y;
  };
  struct Line {
    Pair feed, edge;  ///< per feed per tooth [N/m]; of the edges [N]
  };

  /// Means over a turn of exp(-i order angle) between entry and exit, by order from 0 on.
  static std::vector<Complex> means(const Engagement& engaged, std::size_t orders) {
    std::vector<Complex> all = {(engaged.exit_rad - engaged.start_rad) / kTwoPi};
    const Complex exit_step = std::polar(1.0, -engaged.exit_rad);
    const Complex start_step = std::polar(1.0, -engaged.start_rad);
    Complex exit = 1, start = 1;
    for (std::size_t order = 1; order < orders; ++order) {
      exit *= exit_step, start *= start_step;
      const Complex turn = (exit - start) / (kTwoPi * static_cast<double>(order));
      all.emplace_back(-turn.imag(), turn.real());  // times i
    }
    return all;
  }

  /// Line k of the tooth frequency in the force on the tool, in closed form: of a tooth between
  /// entry and exit, and of the helix, which spreads it over the lag.
  static Line line(const MillingTool& tool, const MillingCut& cut,
                   const std::vector<Complex>& turned, int k) {
    const int n = k * tool.teeth;
    const auto mean = [&](int order) {  // of exp(i order angle), over a turn
      const Complex& m = turned[static_cast<std::size_t>(std::abs(order))];
      return order > 0 ? std::conj(m) : m;
    };
    const Complex over_2i(0, -0.5), first = mean(1 - n), last = mean(-1 - n);
    const Complex c = 0.5 * (first + last), s = over_2i * (first - last);
    const Complex up = mean(2 - n), down = mean(-2 - n);
    const Complex sc = 0.5 * over_2i * (up - down);
    const Complex ss = 0.5 * (mean(-n) - 0.5 * (up + down));
    const double half_lag =
        0.5 * n * cut.axial_depth_m * std::tan(rad_from_deg(tool.helix_deg)) / tool.radius_m();
    const double spread = std::abs(half_lag) > 1e-9 ? std::sin(half_lag) / half_lag : 1;
    const Complex depth =
        std::polar((k == 0 ? 1 : 2) * tool.teeth * cut.axial_depth_m * spread, -half_lag);
    const CuttingForceLaw& law = tool.force;
    const double kt = law.tangential_coefficient_N_per_m2, kr = kt * law.radial_ratio;
    const double te = law.tangential_edge_N_per_m, re = law.radial_edge_N_per_m;
    return {{depth * (-kt * sc - kr * ss), depth * (kt * ss - kr * sc)},
            {depth * (-te * c - re * s), depth * (te * s - re * c)}};
  }

  std::vector<Place> by_feed_, by_edge_;  ///< deflection over a tooth period
};

}  // namespace servosense
