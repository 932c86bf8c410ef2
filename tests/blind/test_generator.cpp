// The blind generator itself: is its physics right, is null really null, is it the same twice?
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

#include "case.hpp"
#include "check.hpp"
#include "drive.hpp"
#include "motion.hpp"

namespace {

using blind::Hidden;
using blind::Plant;

std::string text_of(const std::filesystem::path& path) {
  std::stringstream text;
  text << std::ifstream(path).rdbuf();
  return text.str();
}

/// Without damping the pair keeps its energy: the step is exact, so only rounding is lost.
void energy() { CHECK_NEAR(blind::free_energy_ratio(Plant{}, 10.0), 1.0, 1e-9); }

/// At constant speed the effort is viscous plus Coulomb friction, at any speed and with either
/// friction model; at rest under a small constant load nothing moves.
void friction_levels() {
  for (const bool maxwell_slip : {false, true})
    for (const double speed : {0.02, 0.2}) {
      Plant p;
      p.maxwell_slip = maxwell_slip;
      p.current_noise_A = 0;
      blind::Program program(p.servo_hz, 0);
      program.dwell(0.2);
      program.move(1.5 * speed, speed, 2.0);
      const blind::Recording r = blind::run(p, Hidden{}, program.smoothed(0.02), {}, 1, 1);
      CHECK(r.stable);
      double sum = 0;
      const auto from = static_cast<std::size_t>(1.0 * r.rate_hz);
      const auto to = static_cast<std::size_t>(1.5 * r.rate_hz);
      for (std::size_t i = from; i < to; ++i) sum += r.clean_current_A[i] * p.effort_per_A;
      // The encoder's rounding shakes the loop by a newton; half a second of it averages out.
      CHECK_NEAR(sum / static_cast<double>(to - from), p.coulomb + p.viscous * speed, 0.3);
    }
  Plant p;
  Hidden h;
  h.constant_load = 0.5 * p.coulomb;
  p.position_gain = p.velocity_gain = p.integral_rate = 0;  // nobody holds it but friction
  const blind::Recording r = blind::run(p, h, std::vector<double>(4000, 0.0), {}, 1, 1);
  CHECK_BETWEEN(std::abs(r.clean_motor.back()), 0.1 * p.knee, 5 * p.knee);
  h.constant_load = 1.5 * p.coulomb;
  // Beyond friction it falls: ds = a t^2 / 2 less what viscous friction takes in a second.
  const double a = 0.5 * p.coulomb / p.inertia;
  const double rate = p.viscous / p.inertia;
  const double fall = a / rate * (1 - (1 - std::exp(-rate)) / rate);
  const blind::Recording gone = blind::run(p, h, std::vector<double>(4001, 0.0), {}, 1, 1);
  CHECK_NEAR(-gone.clean_motor.back(), fall, 0.01 * fall);
}

/// Presliding takes the travel that was drawn, however friction is shared between motor and stage:
/// a load of half the friction moves a stiff drive as far.
void presliding_travel() {
  for (const bool maxwell_slip : {false, true}) {
    const auto moved = [maxwell_slip](double motor_share) {
      Plant p;
      p.maxwell_slip = maxwell_slip;
      p.mode_hz = 2000;
      p.friction_motor_share = motor_share;
      p.position_gain = p.velocity_gain = p.integral_rate = 0;
      Hidden h;
      h.constant_load = 0.5 * p.coulomb;
      return blind::run(p, h, std::vector<double>(4000, 0.0), {}, 1, 1).clean_motor.back();
    };
    const double even = moved(0.5);
    CHECK_NEAR(moved(0.9), even, 0.1 * std::abs(even));
  }
}

/// A P-PI loop follows a ramp with the lag of its position gain.
void tracking() {
  Plant p;
  blind::Program program(p.servo_hz, 0);
  program.move(0.3, 0.1, 1.0);
  const std::vector<double> command = program.smoothed(0.02);
  const blind::Recording r = blind::run(p, Hidden{}, command, {}, 1, 3);
  const auto middle = static_cast<std::size_t>(2.0 * r.rate_hz);
  CHECK_NEAR(r.command[middle] - r.clean_motor[middle], 0.1 / p.position_gain,
             0.02 * 0.1 / p.position_gain);
}

/// More of it shows more, for an effect of force, one of memory and one of the sensor. Beyond a
/// tenth of the noise, below which the difference of two runs is rounding.
void monotone() {
  const Plant p;
  blind::Program program(p.servo_hz, 0);
  for (int i = 0; i < 3; ++i) program.to_and_fro(0.05, 0.2, 3.0, 1);
  const std::vector<double> command = program.smoothed(0.02);
  const blind::Recording plain = blind::run(p, Hidden{}, command, {}, 1, 5);
  const auto difference = [&](const Hidden& h) {
    const blind::Recording r = blind::run(p, h, command, {}, 1, 5);
    double sum = 0;
    for (std::size_t i = 0; i < r.clean_current_A.size(); ++i)
      sum += std::pow(r.clean_current_A[i] - plain.clean_current_A[i], 2);
    return std::sqrt(sum / static_cast<double>(r.clean_current_A.size()));
  };
  double drag = 0, play = 0, eccentric = 0;
  for (const double size : {1.0, 2.0, 4.0, 8.0}) {
    Hidden a, b, c;
    a.drag = 100 * size;
    b.backlash = 5e-6 * size;
    c.eccentricity = 1e-6 * size;
    const double with_drag = difference(a), with_play = difference(b), with_c = difference(c);
    CHECK(with_drag > drag);
    CHECK(with_play > play);
    CHECK(with_c > eccentric);
    drag = with_drag, play = with_play, eccentric = with_c;
  }
}

/// The same seed writes the same bytes; another seed, another machine; truth stays in its file.
void determinism(bool nightly) {
  const std::filesystem::path at = std::filesystem::temp_directory_path() / "blind_generator_test";
  for (const char* name :
       {"milling/null", "drive/single/backlash", "spindle/single/torque-ripple"}) {
    if (!nightly && name != std::string("milling/null")) continue;
    for (const char* folder : {"a", "b", "c"})
      blind::write_case(blind::draw_case(name, std::string(folder) == "c" ? 8 : 7, "plain"),
                        (at / folder).string());
    for (const char* file : {"machine.ini", "trace.csv", "truth.json"}) {
      CHECK(text_of(at / "a" / file) == text_of(at / "b" / file));
      CHECK(text_of(at / "a" / file) != text_of(at / "c" / file));
      CHECK(!text_of(at / "a" / file).empty());
    }
    CHECK(text_of(at / "a" / "machine.ini").find("effect") == std::string::npos);
    CHECK(text_of(at / "a" / "trace.csv").find("backlash") == std::string::npos);
    CHECK(text_of(at / "a" / "trace.csv").find('#') == std::string::npos);
  }
  std::filesystem::remove_all(at);
}

/// Null hides nothing, and what the measured gap of a null case holds is a few percent of friction:
/// its friction is a bristle where the workflow has a clamp.
void null_is_null() {
  for (const char* name : {"drive/null", "drive/null-wrong", "spindle/null", "milling/null"})
    for (const std::uint64_t seed : {1u, 2u}) {
      const blind::Case c = blind::draw_case(name, seed, "plain");
      CHECK(c.truth.effects.empty());
      CHECK_TEXT(c.truth.expect, "none");
      CHECK(c.truth.gap_before == c.truth.gap_oracle);
    }
  // The same machine with an effect has the null case's gap as its oracle.
  const blind::Case null = blind::draw_case("drive/null", 4, "plain");
  const blind::Case load = blind::draw_case("drive/single/constant-load", 4, "plain");
  CHECK_NEAR(load.truth.gap_oracle, null.truth.gap_before, 1e-9);
}

/// The strength that the truth gives is what the effect amounts to: a constant load is its own rms.
void strength_of_a_load() {
  const blind::Case c = blind::draw_case("drive/single/constant-load", 4, "plain");
  const blind::HiddenEffect& e = c.truth.effects.front();
  const double load = std::abs(e.parameters.front().second);
  // Refitting Coulomb friction takes part of it where the program dwells longer on one side.
  CHECK_BETWEEN(e.strength * c.truth.noise_floor, 0.8 * load, 1.02 * load);
}

/// No source of the generator includes a header of the rooms under test.
void shares_no_code() {
  for (const auto& entry : std::filesystem::directory_iterator("tests/blind")) {
    const std::string extension = entry.path().extension().string();
    if (extension != ".cpp" && extension != ".hpp") continue;
    std::ifstream in(entry.path());
    int line_number = 0;
    for (std::string line; std::getline(in, line);) {
      ++line_number;
      if (!line.starts_with("#include")) continue;
      const bool own =
          line.find("servosense") == std::string::npos && line.find("..") == std::string::npos;
      if (!own) std::printf("%s:%d: %s\n", entry.path().c_str(), line_number, line.c_str());
      CHECK(own);
    }
  }
  CHECK(text_of("tests/blind/CMakeLists.txt").find("PRIVATE servosense") == std::string::npos);
}

/// A drawn case for every cell, with what its cell promises.
void all_cells() {
  const std::vector<std::string> cells = blind::cells();
  CHECK(cells.size() > 60);
  const blind::Case shifted = blind::draw_case("drive/zero-shift", 3, "plain");
  const std::vector<double>& t = shifted.columns.front().values;
  double longest = 0;
  for (std::size_t i = 1; i < t.size(); ++i) longest = std::max(longest, t[i] - t[i - 1]);
  CHECK_NEAR(longest, 5.0, 0.01);
  const blind::Case holes = blind::draw_case("drive/dropouts", 3, "plain");
  std::size_t bad = 0;
  for (const double i :
       std::ranges::find(holes.columns, "x.current_A", &blind::Column::name)->values)
    bad += std::isnan(i) || i == blind::kAbsent;
  CHECK(bad > 10);
  const blind::Case all = blind::draw_case("drive/single/lead-error", 3, "plain");
  const blind::Case half = blind::draw_case("drive/single/lead-error", 3, "decimated");
  CHECK((all.columns[0].values.size() + 1) / 2 == half.columns[0].values.size());
  CHECK_TEXT(all.columns[2].name, "x.angle_counts");
  CHECK_TEXT(all.columns[3].name, "x.position_m");
}

}  // namespace

int main(int argc, char** argv) {
  const bool nightly = check::nightly(argc, argv);
  energy();
  friction_levels();
  presliding_travel();
  tracking();
  monotone();
  determinism(nightly);
  null_is_null();
  strength_of_a_load();
  shares_no_code();
  all_cells();
  return check::done();
}
