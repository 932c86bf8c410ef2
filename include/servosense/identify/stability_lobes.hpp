// Stability lobes of milling by zeroth-order averaging (Altintas-Budak, as in Koike 2016,
// eq. 2-84 to 2-100, and Dunwoody 2010, eq. 6.2 to 6.14), and what an unknown radial coefficient
// leaves of them.
//
// With alpha the mean directional coefficients and G the receptance of the tool tip, let lambda(w)
// be an eigenvalue of alpha G(jw). The tool is on the border of stability at frequency w when
//   1/lambda = (N Kt / 4 pi) a (1 - exp(-j w T)),
// and because |1 - exp(-j x)|^2 = 2 Re(1 - exp(-j x)) this has the explicit solution
//   a = 2 pi / (N Kt Re lambda),   w T = pi + 2 arg lambda + 2 pi k,   k = 0, 1, 2, ...
// wherever Re lambda > 0. A maximum of Re lambda is the bottom of a lobe for every k.
//
// Valid while several teeth share the cut or the engagement is wide. At small immersion the cut is
// interrupted: flip lobes appear, which only semi_discretization.hpp shows.
// Edge forces, run-out and process damping do not enter. Kt is taken at the reference chip
// thickness. Tools of unequal pitch are refused.
#pragma once

#include <complex>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/model/milling.hpp"
#include "servosense/model/structural_mode.hpp"

namespace servosense {

/// A point of a stability chart. `axial_depth_m` is the limit depth: infinite (and the frequency
/// NaN) where nothing limits it.
struct LobePoint {
  double spindle_speed_rpm = 0;
  double axial_depth_m = 0;
  double chatter_frequency_hz = 0;
};

/// One lobe, in the order of rising chatter frequency. Every mode that can chatter has its own
/// curve for each k.
struct LobeCurve {
  int lobe = 0;  ///< k, whole waves left between two teeth
  std::vector<LobePoint> points;
};

/// A local maximum of the limit depth: where two lobes meet, and the chatter frequency jumps down
/// as the speed rises.
struct StabilityPocket {
  double spindle_speed_rpm = 0;
  double axial_depth_m = 0;
  double chatter_frequency_below_hz = 0;  ///< just below the pocket speed
  double chatter_frequency_above_hz = 0;  ///< just above it
};

/// Spindle speeds from..to, both ends included.
struct SpeedInterval {
  double from_rpm = 0;
  double to_rpm = 0;
};

/// Directional coefficients: force (Fx, Fy) per (Kt a / 2) and displacement (x, y), x the feed.
struct DirectionalCoefficients {
  double xx = 0, xy = 0, yx = 0, yy = 0;
};

/// The first tooth that stands off its equal pitch, counted from 1; nothing when all teeth are
/// even.
[[nodiscard]] std::optional<int> tooth_off_pitch(const MillingTool& tool);

/// Integral over the engagement of one tooth [rad]; N/2pi times it is the mean over a revolution
/// (Dunwoody 2010, ch. 6; Koike 2016, eq. 2-84).
[[nodiscard]] DirectionalCoefficients engagement_integral(const Engagement& engagement,
                                                          double radial_ratio);

/// Measured receptance X/F [m/N] at rising frequencies; linear in between.
struct ReceptanceTable {
  std::vector<double> frequency_hz;
  std::vector<std::complex<double>> receptance_m_per_N;
};

/// Receptances of the tool tip. An empty table is zero; xx or yy must be there. `xy` is the x
/// displacement per y force. Lobes are sought where all given tables have values.
struct ToolTipReceptance {
  ReceptanceTable xx, yy, xy, yx;
};

class OrientedReceptance;

/// Zeroth-order stability chart of one tool, engagement and structure. Spindle speed and depth of
/// the cut are not used: they are the axes of the chart.
class StabilityLobes {
 public:
  /// Errors: no modes, a mode without positive frequency, damping and mass, no teeth, unequal
  /// pitch, no tangential coefficient, immersion outside 0..diameter.
  static Expected<StabilityLobes> from_modes(const Structure& structure, const MillingTool& tool,
                                             const MillingCut& cut);
  /// Errors as above, and tables that are unordered, unequal in length or do not overlap.
  static Expected<StabilityLobes> from_receptance(const ToolTipReceptance& receptance,
                                                  const MillingTool& tool, const MillingCut& cut);

  /// Smallest limit depth of all lobes at one spindle speed (> 0).
  [[nodiscard]] LobePoint limit_at(double spindle_speed_rpm) const;
  /// The lower envelope. Errors: no speed, or one that is not positive.
  [[nodiscard]] Expected<std::vector<LobePoint>> envelope(
      std::span<const double> spindle_speed_rpm) const;
  /// Curves of lobes first..last.
  [[nodiscard]] std::vector<LobeCurve> lobes(int first, int last) const;
  /// The deepest cut that is stable at every speed, at the speed where lobe k touches it.
  [[nodiscard]] LobePoint minimum(int lobe = 0) const;
  /// Local maxima of the envelope, by rising speed, but for slow ones less than 1 % deeper than the
  /// minimum.
  [[nodiscard]] std::vector<StabilityPocket> pockets(double from_rpm, double to_rpm) const;
  /// Speeds at which this depth chatters, by rising speed and disjoint.
  [[nodiscard]] std::vector<SpeedInterval> unstable_speeds(double axial_depth_m, double from_rpm,
                                                           double to_rpm) const;

 private:
  /// A point of the border before a lobe number gives it a speed.
  struct Node {
    double omega_rad_s;
    std::complex<double> lambda;
    double phase_rad;  ///< w T modulo 2 pi, 0..2pi
    double depth_m;
  };
  /// A stretch of w with Re lambda > 0 that holds one lobe bottom.
  using Piece = std::vector<Node>;
  /// Where the envelope is found: which piece, which lobe, which frequency.
  struct Contact {
    int piece = -1;
    int lobe = 0;
    double omega_rad_s = 0;
    double depth_m = 0;
  };

  StabilityLobes(std::shared_ptr<const OrientedReceptance> loop, const MillingTool& tool);
  [[nodiscard]] Node node(double omega_rad_s, std::complex<double> lambda) const;
  [[nodiscard]] Node node_between(const Node& left, const Node& right, double omega_rad_s) const;
  [[nodiscard]] Contact contact_at(double spindle_speed_rpm) const;
  void find_jumps(double low_rpm, const Contact& low, double high_rpm, const Contact& high,
                  std::vector<StabilityPocket>& found) const;

  std::shared_ptr<const OrientedReceptance> loop_;
  std::vector<Piece> pieces_;
  double teeth_ = 0;
  double depth_scale_ = 0;  ///< 2 pi / (N Kt)
};

/// Limit depth when the radial ratio is only known to lie in a range (Dunwoody 2010, ch. 6).
struct LimitDepthBand {
  std::vector<double> spindle_speed_rpm;
  std::vector<double> lowest_depth_m;   ///< stable below this whatever the ratio
  std::vector<double> highest_depth_m;  ///< unstable above this whatever the ratio
};

/// The range is sampled at `ratios` values, ends included. Errors as from_modes and envelope, and
/// a range that is negative or reversed. tool.force.radial_ratio is not used.
[[nodiscard]] Expected<LimitDepthBand> limit_depth_band(
    const Structure& structure, const MillingTool& tool, const MillingCut& cut, double ratio_low,
    double ratio_high, std::span<const double> spindle_speed_rpm, int ratios = 33);

/// Speeds in from..to at which `axial_depth_m` is stable for every radial ratio of the range.
[[nodiscard]] Expected<std::vector<SpeedInterval>> safe_speeds(
    const Structure& structure, const MillingTool& tool, const MillingCut& cut, double ratio_low,
    double ratio_high, double axial_depth_m, double from_rpm, double to_rpm, int ratios = 33);

}  // namespace servosense
