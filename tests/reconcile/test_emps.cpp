// EMPS, from mass and viscous friction only: what its publishers found must come out, and hold on
// their second record, judged by their own protocol (Janot, Gautier and Brunot 2019): Butterworth
// of fourth order at 100 Hz, forward and backward, central differences, every tenth row (behind
// a Chebyshev of eighth order, 0.05 dB, at 40 Hz, forward and backward),
// 100 |measured - model| / |measured|.
#include <cmath>
#include <complex>
#include <cstdio>
#include <string>
#include <vector>

#include "check.hpp"
#include "oracles/emps.hpp"
#include "servosense/reconcile/drive.hpp"

using namespace servosense;
using namespace servosense::reconcile;

namespace {

using Series = std::vector<double>;
constexpr double kPi = 3.14159265358979323846;

/// One second-order section of a low-pass, bilinear with prewarping. `size` and `quality` of its
/// pair of analog poles, the corner being 1.
Series section(const Series& x, double corner_hz, double size, double quality) {
  const double k = size * std::tan(kPi * corner_hz * oracle::kEmpsPeriod_s);
  const double norm = 1 / (1 + k / quality + k * k);
  const double b = k * k * norm, a1 = 2 * (k * k - 1) * norm, a2 = (1 - k / quality + k * k) * norm;
  Series y(x.size());
  double x1 = x[0], x2 = x[0], y1 = x[0], y2 = x[0];
  for (std::size_t i = 0; i < x.size(); ++i) {
    y[i] = b * (x[i] + 2 * x1 + x2) - a1 * y1 - a2 * y2;
    x2 = x1;
    x1 = x[i];
    y2 = y1;
    y1 = y[i];
  }
  return y;
}

/// Forward and backward. Poles of a Chebyshev low-pass of the first kind; without ripple they lie
/// on a circle: Butterworth.
Series low_pass(Series x, double corner_hz, int order, double ripple_db) {
  const double a =
      ripple_db > 0 ? std::asinh(1 / std::sqrt(std::pow(10, ripple_db / 10) - 1)) / order : 0;
  for (int pass = 0; pass < 2; ++pass) {
    for (int k = 0; k < order / 2; ++k) {
      const double angle = kPi * (2 * k + 1) / (2 * order);
      const std::complex<double> pole =
          ripple_db > 0 ? std::complex<double>(-std::sinh(a) * std::sin(angle),
                                               std::cosh(a) * std::cos(angle))
                        : std::complex<double>(-std::sin(angle), std::cos(angle));
      x = section(x, corner_hz, std::abs(pole), -std::abs(pole) / (2 * pole.real()));
    }
    x = Series(x.rbegin(), x.rend());
  }
  return x;
}

Series slope(const Series& x) {
  Series d(x.size(), 0);
  for (std::size_t i = 1; i + 1 < x.size(); ++i)
    d[i] = (x[i + 1] - x[i - 1]) / (2 * oracle::kEmpsPeriod_s);
  return d;
}

struct Friction {
  double forward_viscous, backward_viscous, forward_coulomb, backward_coulomb, offset;
};

/// Relative error of the force [%].
double by_protocol(const std::vector<oracle::EmpsRow>& rows, double mass, const Friction& f) {
  Series position, force;
  for (const oracle::EmpsRow& row : rows) {
    position.push_back(row.position_m);
    force.push_back(row.output_V * oracle::kEmpsForce_N_per_V);
  }
  const Series velocity = slope(low_pass(position, 100, 4, 0));
  const Series acceleration = slope(velocity);
  Series model(force.size());
  for (std::size_t i = 0; i < model.size(); ++i) {
    const double v = velocity[i];
    const double friction = v > 0   ? f.forward_viscous * v + f.forward_coulomb
                            : v < 0 ? f.backward_viscous * v - f.backward_coulomb
                                    : 0;
    model[i] = mass * acceleration[i] + friction + f.offset;
  }
  const Series thin_force = low_pass(force, 40, 8, 0.05);
  const Series thin_model = low_pass(model, 40, 8, 0.05);
  constexpr std::size_t kEnds = 50;  // differences at the ends say nothing
  double square = 0, whole = 0;
  for (std::size_t i = kEnds; i + kEnds < force.size(); i += 10) {
    square += (thin_force[i] - thin_model[i]) * (thin_force[i] - thin_model[i]);
    whole += thin_force[i] * thin_force[i];
  }
  return 100 * std::sqrt(square / whole);
}

DriveData drive_of(std::vector<oracle::EmpsRow> rows, const char* source) {
  DriveData d;
  d.source = source;
  d.sample_period_s = d.servo_period_s = oracle::kEmpsPeriod_s;
  d.model.inertia = 95;
  d.model.viscous = 203;
  d.model.unit_per_turn = 0.0025;
  d.model.friction_knee = 5e-6;
  d.observer = oracle::emps_observer();
  d.unit_per_count = 5e-8;
  d.start_position = rows.front().position_m;
  for (oracle::EmpsRow& row : rows) row.pulse_V = 0;  // the motor did exert it
  d.samples = oracle::emps_samples(rows);
  return d;
}

void publishers_findings(const std::string& folder) {
  const auto estimation = oracle::read_emps(folder + "/emps_train.csv");
  const auto pulses = oracle::read_emps(folder + "/emps_pulses_dev.csv");

  // The oracle itself: the published parameters give the published errors. Within 0.1: how many
  // rows at the ends were left out is not stated, and only half of the second record is here.
  const Friction symmetric{203.5034, 203.5034, 20.3935, 20.3935, -3.1648};
  CHECK_NEAR(by_protocol(estimation, 95.1089, symmetric), 4.0834, 0.1);
  CHECK_NEAR(by_protocol(pulses, 95.1089, symmetric), 5.9824, 0.1);
  const Friction asymmetric{166.7061, 240.4236, 20.1440, 20.6277, 0};
  CHECK_NEAR(by_protocol(estimation, 95.1540, asymmetric), 3.1117, 0.1);

  const DriveData second = drive_of(pulses, "pulses");
  auto outcome = reconcile_drive(drive_of(estimation, "estimation"), {}, &second);
  CHECK(outcome.has_value());
  if (!outcome) return;
  const Report& r = outcome->report;
  std::printf("%s\n", r.summary.c_str());
  CHECK(r.effects.size() == 2);
  if (r.effects.size() != 2) return;
  CHECK(r.effects[0].name == "coulomb-friction" && r.effects[1].name == "asymmetric-friction");
  CHECK(r.second.refuted.empty());
  for (const SecondGap& g : r.second.effects) CHECK(g.shown && g.gap_after < 0.7 * g.gap_before);

  const DriveModelConfig& m = outcome->model;
  double coulomb = 0, viscous_difference = 0, coulomb_difference = 0;
  for (const FoundEffect& e : r.effects)
    for (const NamedValue& v : e.parameters) {
      if (v.key == "force_N") coulomb = v.values[0];
      if (v.key == "viscous_difference_N_s_per_m") viscous_difference = v.values[0];
      if (v.key == "coulomb_difference_N") coulomb_difference = v.values[0];
    }
  const Friction found{m.viscous + viscous_difference / 2, m.viscous - viscous_difference / 2,
                       coulomb + coulomb_difference / 2, coulomb - coulomb_difference / 2, 0};
  const double on_estimation = by_protocol(estimation, m.inertia, found);
  const double on_pulses = by_protocol(pulses, m.inertia, found);
  std::printf("mass %.2f, forward %.1f and %.2f, backward %.1f and %.2f\n", m.inertia,
              found.forward_viscous, found.forward_coulomb, found.backward_viscous,
              found.backward_coulomb);
  std::printf("relative force error: estimation %.3f %%, pulses %.3f %%\n", on_estimation,
              on_pulses);
  // The published errors are the bounds.
  CHECK(on_estimation <= 3.1117);
  CHECK(on_pulses <= 5.9824);
}

}  // namespace

int main() {
  if (const std::string folder = check::outside_data("emps"); !folder.empty())
    publishers_findings(folder);
  return check::done();
}
