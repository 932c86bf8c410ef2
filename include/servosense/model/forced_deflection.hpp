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
    const std::vector<Force> force = forces(tool, cut, looks);
    by_feed_.assign(looks, {});
    by_edge_.assign(looks, {});
    for (std::size_t k = 0; k <= lines; ++k) {
      const double w = static_cast<double>(k) * tooth_rad_s;
      std::complex<double> gx = 0, gy = 0;
      for (const StructuralMode& m : structure.x) gx += m.receptance(w);
      for (const StructuralMode& m : structure.y) gy += m.receptance(w);
      std::complex<double> fx = 0, fy = 0, ex = 0, ey = 0;
      const std::complex<double> turn =
          std::polar(1.0, -kTwoPi * static_cast<double>(k) / static_cast<double>(looks));
      std::complex<double> phase = (k == 0 ? 1.0 : 2.0) / static_cast<double>(looks);
      for (const Force& f : force) {
        fx += f.feed.x * phase, fy += f.feed.y * phase;
        ex += f.edge.x * phase, ey += f.edge.y * phase;
        phase *= turn;
      }
      phase = 1;
      for (std::size_t i = 0; i < looks; ++i) {
        by_feed_[i].x += (gx * fx * phase).real(), by_feed_[i].y += (gy * fy * phase).real();
        by_edge_[i].x += (gx * ex * phase).real(), by_edge_[i].y += (gy * ey * phase).real();
        phase *= std::conj(turn);
      }
    }
  }

  /// Farthest that the tool tip is from where it is at rest [m].
  [[nodiscard]] double farthest_m(double feed_per_tooth_m) const {
    double most = 0;
    for (std::size_t i = 0; i < by_feed_.size(); ++i)
      most = std::max(most, std::hypot(by_feed_[i].x * feed_per_tooth_m + by_edge_[i].x,
                                       by_feed_[i].y * feed_per_tooth_m + by_edge_[i].y));
    return most;
  }

 private:
  struct Pair {
    double x = 0, y = 0;
  };
  struct Force {
    Pair feed, edge;  ///< per feed per tooth [N/m]; of the edges [N]
  };

  /// On the tool over a tooth period.
  static std::vector<Force> forces(const MillingTool& tool, const MillingCut& cut,
                                   std::size_t looks) {
    const Engagement engaged = engagement_of(tool, cut);
    const CuttingForceLaw& law = tool.force;
    const double pitch = kTwoPi / tool.teeth;
    const double lag = cut.axial_depth_m * std::tan(rad_from_deg(tool.helix_deg)) / tool.radius_m();
    // Layers and looks that no entry or exit slips between.
    const int layers = lag > 0 ? std::max(8, static_cast<int>(std::ceil(lag / 0.05))) : 1;
    constexpr int kWithin = 4;
    const double slice_m = cut.axial_depth_m / (layers * kWithin);
    std::vector<Force> all(looks);
    for (std::size_t i = 0; i < looks; ++i)
      for (int part = 0; part < kWithin; ++part)
        for (int layer = 0; layer < layers; ++layer)
          for (int tooth = 0; tooth < tool.teeth; ++tooth) {
            const double turned = (static_cast<double>(i) + (part + 0.5) / kWithin - 0.5) /
                                      static_cast<double>(looks) * pitch +
                                  tooth * pitch - lag * (layer + 0.5) / layers;
            const double angle = turned - kTwoPi * std::floor(turned / kTwoPi);
            if (angle < engaged.start_rad || angle > engaged.exit_rad) continue;
            const double s = std::sin(angle), c = std::cos(angle);
            const double kt = law.tangential_coefficient_N_per_m2, kr = kt * law.radial_ratio;
            Force& f = all[i];
            f.feed.x += slice_m * s * (-kt * c - kr * s);
            f.feed.y += slice_m * s * (kt * s - kr * c);
            f.edge.x += slice_m * (-law.tangential_edge_N_per_m * c - law.radial_edge_N_per_m * s);
            f.edge.y += slice_m * (law.tangential_edge_N_per_m * s - law.radial_edge_N_per_m * c);
          }
    return all;
  }

  std::vector<Pair> by_feed_, by_edge_;  ///< deflection over a tooth period
};

}  // namespace servosense
