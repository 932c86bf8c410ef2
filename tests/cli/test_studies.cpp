// servosense study: the figures of the works beside those obtained, pictures, and the same of a
// machine's own drives; what is refused.
#include <cmath>
#include <cstdio>
#include <random>
#include <string>

#include "check.hpp"
#include "program.hpp"

namespace {

using namespace program_test;

const char* const kMachine =
    "[machine]\nname = oracle\nsample_rate_hz = 4000\n[axis.x]\nlead_m = 0.01\n"
    "equivalent_mass_kg = 100\nviscous_friction_N_s_per_m = 200\ncoulomb_friction_N = 50\n"
    "force_constant_N_per_A = 100\nencoder_counts_per_rev = 65536\n[observer.x]\n"
    "disturbance_cutoff_rad_s = 500\nvelocity_cutoff_rad_s = 500\n[cut]\n"
    "spindle_speed_rpm = 1000\n";

/// An axis that swings, 0.2 m/s at most, under a motor that is right to 1 % of its mass.
void write_idle() {
  std::string text = "t_s,x.angle_counts,x.current_A\n";
  for (int i = 0; i < 20000; ++i) {
    const double t = i / 4000.0, w = 2 * M_PI;
    const double x = 0.2 / w * std::sin(w * t), v = 0.2 * std::cos(w * t),
                 a = -0.2 * w * std::sin(w * t);
    const double force = 101 * a + 200 * v + std::copysign(50.0, v);
    char line[80];
    std::snprintf(line, sizeof line, "%.6f,%ld,%.6f\n", t, std::lround(x / 0.01 * 65536),
                  force / 100);
    text += line;
  }
  put("idle.csv", text);
}

Json study(const std::string& arguments, const std::string& title) {
  const Outcome o = run("study " + arguments + " --report page.html --json --quiet");
  that(o.status == 0, o, "works", __LINE__);
  that(contains(content(folder / "page.html"), title), o, "writes its page", __LINE__);
  that(contains(content(folder / "page.html"), "<svg"), o, "with pictures", __LINE__);
  return Json(o.out);
}

void encoder() {
  const Json json = study("encoder --machine m.ini --trace idle.csv", "Encoder resolution");
  CHECK(json.number("compared.0.published") == 17 && json.number("compared.0.obtained") == 17);
  CHECK_NEAR(json.number("compared.2.obtained"), 35.0, 0.5);
  CHECK(json.sizes.at("noise") == 2 * 5 * 15);
  CHECK_TEXT(json.text("drives.0.channel"), "x");
  // The highest of the trace, over 25 ms of a sine of 1 Hz: 0.1 % below its peak.
  CHECK_NEAR(json.number("drives.0.speed"), 0.1998, 1e-4);
  CHECK(json.number("drives.0.amplitude") > 0);
  refused("study encoder --trace idle.csv", 2, {"give both"}, __LINE__);
  put("bare.ini", "[machine]\nname = bare\n");
  refused("study encoder --machine bare.ini", 3, {"bare.ini", "encoder_counts_per_rev"}, __LINE__);
}

void cutoff() {
  const Json json = study("cutoff --machine m.ini --trace idle.csv", "Choice of the cutoff");
  CHECK_BETWEEN(json.number("compared.0.obtained"), 300, 400);
  CHECK(json.sizes.at("sweeps") == 2);
  CHECK_TEXT(json.text("sweeps.1.drive"), "x");
  CHECK(json.number("sweeps.1.best_ratio") > 1);
  // A softer contact stands out less; the longer, the lower its best cutoff.
  const Json soft =
      study("cutoff --machine m.ini --trace idle.csv --contact-rate 177e3 --contact-s 0.04",
            "Choice of the cutoff");
  CHECK(soft.number("sweeps.1.best_cutoff_rad_s") < json.number("sweeps.1.best_cutoff_rad_s"));
  CHECK(soft.number("compared.1.obtained") == json.number("compared.1.obtained"));
  refused("study cutoff --machine m.ini", 2, {"--machine and --trace go together"}, __LINE__);
}

void order() {
  const Json own = study("order", "Order of an autoregressive model");
  CHECK(own.number("samples_per_turn") == 12);
  CHECK(own.sizes.at("aic") == 61);
  CHECK(own.number("published_candidates.1") == 11);
  // Of third order: that, and nothing that tells more.
  std::mt19937_64 random(61001);
  std::normal_distribution<double> normal;
  std::string text = "t_s,spindle.current_A,x.current_A\n";
  double a = 0, b = 0, c = 0;
  for (int i = 0; i < 4000; ++i) {
    const double z = 1.2 * a - 0.7 * b + 0.3 * c + normal(random);
    c = b, b = a, a = z;
    text += std::to_string(i * 0.005) + "," + std::to_string(50 + z) + "," +
            std::to_string(normal(random)) + "\n";
  }
  put("cut.csv", text);
  const Json third = study("order --machine m.ini --trace cut.csv --most 30", "spindle.current_A");
  // The mean is one more constant, which a longer model takes as well.
  CHECK_BETWEEN(third.number("candidates.0"), 3, 5);
  CHECK_NEAR(third.number("samples_per_turn"), 12, 1e-6);
  const Json half = study("order --trace cut.csv --column x.current_A --every 2", "x.current_A");
  CHECK(half.number("samples") == 2000);
  CHECK_NEAR(half.number("sample_period_s"), 0.01, 1e-9);
  CHECK(half.sizes.at("candidates") <= 1);
  refused("study order --trace cut.csv --column y.current_A", 3, {"cut.csv", "y.current_A"},
          __LINE__);
  refused("study order --every 2", 2, {"give --trace"}, __LINE__);
  refused("study order --trace cut.csv --most 2.5", 2, {"whole number"}, __LINE__);
}

}  // namespace

int main() {
  return in_own_folder("studies", [] {
    put("m.ini", kMachine);
    write_idle();
    encoder();
    cutoff();
    order();
  });
}
