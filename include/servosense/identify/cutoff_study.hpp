// At which cutoff does a contact stand out most from idling?
//
// Purpose: Koike 2016, sec. 5.3: for every cutoff g the peak of the estimated force rate (jerk) in
// a collision over that in an idling run, and how long the contact takes to be seen. The observer
// is linear: a contact adds its own response to whatever the axis does.
//   rate = s g/(s+g) F,  F = (g/(s+g))^2 times the force          (Koike 2016, eq. 2-22, sec. 5.2)
// Low cutoffs spread a contact of some milliseconds over their own time constant while what the
// accelerations leave stays; high ones hear the encoder, which grows with g^3. Between them the
// ratio has its greatest value: his 335 rad/s. Bad at: contacts of another length, for which
// another cutoff is best; give yours.
#pragma once

#include <span>
#include <vector>

#include "servosense/core/drive_sample.hpp"
#include "servosense/observer/disturbance_observer.hpp"

namespace servosense {

/// A force that rises at one rate, then is gone (the tool is broken, or the axis has stopped).
struct Contact {
  double rate = 354e3;  ///< N/s or Nm/s
  double duration_s = 4.4e-3;
};

struct CutoffPoint {
  double cutoff_rad_s = 0;
  double idle_force = 0;    ///< standard deviation of the estimate about its mean over 50 ms
  double idle_rate = 0;     ///< largest of the force rate in the idling run
  double contact_rate = 0;  ///< of the contact alone
  double seen_after_s = 0;  ///< until the force rate passes idle_rate; infinite: never
  [[nodiscard]] double ratio() const { return contact_rate / idle_rate; }
};

/// `base`: the drive with its model; its cutoffs are replaced. `idle` is an idling run at its
/// sample period, of any length beyond the observer's settling.
[[nodiscard]] CutoffPoint study_cutoff(const DisturbanceObserverConfig& base,
                                       std::span<const DriveSample<double>> idle,
                                       const Contact& contact, double cutoff_rad_s);

/// The idling run of the study: axis x of the source (227 kg, 732 N s/m, 94 N) between 0 and 50
/// m/min with 10 m/s2, whose model is `mass_error` off and whose position has white noise.
struct StudiedAxis {
  DisturbanceObserverConfig model;
  std::vector<DriveSample<double>> idle;
};
[[nodiscard]] StudiedAxis studied_axis(double mass_error = 0.02, double position_noise_m = 1.6e-7,
                                       double duration_s = 8, unsigned long seed = 1);

}  // namespace servosense
