// Cutting torque of a step, as a mean over a revolution, from what the step removes and touches.
//
//   M = k1 V f + (k2 f + k3) S      (Bertok 1984, eq. 4.1)
//
// with V the cross-section that is removed (volume over path), S the area of contact, f the feed
// per tooth. The mechanistic law (Dunwoody 2010, eq. 2.1) gives the same form for any shape of
// cutter and any engagement: a tooth's tangential force Kt h + Kte along its edge makes, over a
// revolution,
//   M = N/2pi (Kt f V + Kte S)
// because the chips of a revolution are what it removes and its edges pass over what it touches: k1
// = N Kt/2pi, k2 = 0, k3 = N Kte/2pi. Of a drill that is Kt f_rev D^2/8 (V = pi D^2/4), of a face
// of a plunging cutter the same.
#pragma once

#include <numbers>

namespace servosense::process {

struct TorqueEquation {
  double k1_N_per_m2 = 0;  ///< 1e9 times k1 in Nm/mm3
  double k2_N_per_m2 = 0;  ///< the same of k2
  double k3_N_per_m = 0;   ///< 1e6 times k3 in Nm/mm2

  /// k1, k2 [Nm/mm3], k3 [Nm/mm2], as the study and machine files have them.
  static TorqueEquation of(double k1, double k2, double k3) {
    return {k1 * 1e9, k2 * 1e9, k3 * 1e6};
  }
  /// Of `teeth` edges with tangential coefficients Kt [N/m2] and Kte [N/m].
  static TorqueEquation mechanistic(int teeth, double tangential_N_per_m2, double edge_N_per_m) {
    const double share = teeth / (2 * std::numbers::pi);
    return {share * tangential_N_per_m2, 0, share * edge_N_per_m};
  }

  /// Where nothing is removed it is 0. Areas [m2], feed per tooth [m].
  [[nodiscard]] double torque_Nm(double removed_m2, double contact_m2, double feed_m) const {
    if (!(removed_m2 > 0)) return 0;
    return k1_N_per_m2 * removed_m2 * feed_m + edge_N_per_m(feed_m) * contact_m2;
  }
  /// What an area of contact adds [Nm/m2].
  [[nodiscard]] double edge_N_per_m(double feed_m) const {
    return k2_N_per_m2 * feed_m + k3_N_per_m;
  }
  /// Feed per tooth at which the torque is `torque_Nm` [m]; negative: it is more at any feed.
  [[nodiscard]] double feed_m(double torque_Nm, double removed_m2, double contact_m2) const {
    return (torque_Nm - k3_N_per_m * contact_m2) /
           (k1_N_per_m2 * removed_m2 + k2_N_per_m2 * contact_m2);
  }
};

}  // namespace servosense::process
