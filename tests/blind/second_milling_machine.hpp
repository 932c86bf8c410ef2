// A milling machine of the second generator: what is cut, how it is recorded, what its file says.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "analysis.hpp"
#include "case.hpp"
#include "draw.hpp"
#include "second_cut.hpp"

namespace blind::second_milling {

inline double rms_of(const Signal& v) { return rms(v, 0, v.size()); }

struct Level {
  double feed = 1e-4, seconds = 1;
};

/// Resonance of the force sensor; none at 0 Hz.
struct Sensor {
  double hz_x = 0, hz_y = 0, damping = 0.03;
  double share = 1;  ///< that no compensation has taken out
};

/// What a record has beside the cut.
struct Recorder {
  double rate_hz = 10000;
  bool mean = false;  ///< of the time about a sample, else of its instant
  bool counts = false, has_z = false, feed_column = true, sparse_feed = false;
  int counts_per_rev = 4096;
  double zero = 0;  ///< of the spindle's angle
  double noise_N = 0;
  double offset_N[3]{}, drift_N[3]{};  ///< of the amplifier, the drift to the end of the record
  double ramp_s = 0.03;                ///< in which a feed changes
  double air_before_s = 0, air_after_s = 0;
};

struct Machine {
  std::string maker;
  Cutter cutter;
  double speed = 100;  ///< rad/s
  std::vector<Level> levels;
  Sensor sensor;
  Recorder recorder;
  bool everything_wrong = false;  ///< the file's geometry and structure too, not only coefficients
  Cutter file;                    ///< what the file says of it

  [[nodiscard]] double turn_s() const;
  [[nodiscard]] double cutting_s() const;
};

/// What the cut or the shop needs to show the effect.
struct Needs {
  bool structure = false, slow = false, several_feeds = false, one_feed = false, helix = false;
};

Mode draw_mode(Draw&, char axis);
Machine draw_machine(Draw&, const Needs&);

/// Draws what the file says, up to a tenth wrong. Effects that the model lacks are not in it.
void write_down(Machine&, Draw&);
std::string file_text(const Machine&);

/// Forces of the sensor over a turn in steady cutting, x and y of one feed after another.
std::vector<double> steady(const Machine&, bool* periodic = nullptr);

/// What is left of `measured` when the model's own coefficients, its angular zero and the zeros of
/// the sensor are refitted; rms.
double left_over(const std::vector<double>& measured, const Machine& model);

/// Disturbs the cut, and then the forces.
struct Disturbance {
  std::function<void(double t, Moment&)> moment;
  std::function<void(double t, double force[3])> force;
};

std::vector<Column> record(const Machine&, const Disturbance&, Draw&);

}  // namespace blind::second_milling
