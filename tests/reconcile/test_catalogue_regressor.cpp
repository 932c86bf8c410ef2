// The columns with which the workflow looks for an effect, against the force with which the
// simulator's component disturbs the drive.
//
// The oracle: what a record of the simulated drive leaves over from its own inertia and friction,
//   r(t) = u - J a - D v - C S - L
// by differences of a noise-free record, at the servo rate. The column: the effect's class driven
// along the measured motion at the working rate, seven times slower. Both then pass the same
// Gaussian, and the column, at the hidden parameters, has to be the residual.
#include <algorithm>
#include <cmath>
#include <memory>
#include <string>

#include "catalogue_cases.hpp"
#include "check.hpp"
#include "reconcile/drive/candidates/candidates.hpp"
#include "servosense/model/elastoplastic_sign.hpp"

using namespace servosense;
using namespace servosense::reconcile;

namespace {

constexpr double kCorner_hz = 70;

/// What of an effect's force its column may miss, rms.
double bound(const std::string& effect, bool load_rubs) {
  // Interpolation of the effort and the slow working rate: (w T)^2 / 12 at the corner is 1.2 %, and
  // efforts lie far below it.
  double share = 0.01;
  // 60 turns a second, where only the foot of the filter is left, and the product of error and
  // slope, which the class neglects.
  if (effect == "lead-error") share = 0.015;
  // The class takes what the motor exerts, its own friction in it; the column what the motion takes
  // without. Their ratio is 1 - mu; recalibrated inertia and friction, as in a search, have it in.
  if (effect == "load-dependent-friction") share = 0.105;
  // The load bounces on its flanks at 200 Hz; of that the smoothed motion of the motor tells the
  // first impact and no more.
  if (effect == "backlash") share = 0.25;
  // Friction at the load is held over each sample of the slow working rate.
  if (load_rubs) share = 0.07;
  return share;
}

/// What mass and friction of the machine do not explain, at every sample.
Column residual_of(const DriveData& data, const DriveModelConfig& plain) {
  const std::size_t n = data.samples.size();
  Column position(n, 0), sign(n, 0), out(n, 0);
  ElastoplasticSign<double> direction;
  direction.configure(plain.friction_knee);
  for (std::size_t i = 1; i < n; ++i) {
    position[i] = position[i - 1] + data.samples[i].increment;
    sign[i] = direction.process(data.samples[i].increment);
  }
  const double T = data.sample_period_s;
  for (std::size_t i = 1; i + 1 < n; ++i) {
    // The simulator holds the effort from one sample to the next: at a sample, the mean of both.
    const double effort = (data.samples[i - 1].effort + data.samples[i].effort) / 2;
    out[i] = effort -
             plain.inertia * (position[i + 1] - 2 * position[i] + position[i - 1]) / (T * T) -
             plain.viscous * (position[i + 1] - position[i - 1]) / (2 * T) -
             plain.coulomb * sign[i] - plain.constant_load;
  }
  return out;
}

double rms(const Column& x, const std::vector<bool>& usable) {
  double square = 0, n = 0;
  for (std::size_t i = 0; i < x.size(); ++i)
    if (usable[i]) square += x[i] * x[i], ++n;
  return std::sqrt(square / n);
}

Column less(Column a, const Column& b, double factor = 1) {
  for (std::size_t i = 0; i < a.size(); ++i) a[i] -= factor * b[i];
  return a;
}

/// Where a candidate has to be looked for to find this setting: its nonlinear parameters, and the
/// coefficients of its columns.
struct Place {
  std::vector<double> theta, coefficients;
};

Place place_of(const EffectSetting& s, const DriveModelConfig& model) {
  const std::string name = kDriveEffects[s.effect].name;
  const double a = s.scalar(0), b = s.scalar(1), c = s.scalar(2);
  // Candidates with columns of their own.
  if (name == "presliding-hysteresis") return {{b / a, model.friction_knee}, {b}};
  if (name == "flexible-coupling")
    return {{a * std::sqrt(1 - c), b * std::sqrt(1 - c), s.scalar(3) / c, model.friction_knee},
            {c}};
  if (name == "backlash") return {{a, 1, 1}, {model.load_inertia_share}};
  if (name == "position-dependent-friction")
    return {{2}, {s.parameters[0].value[3] - s.parameters[0].value[1]}};
  if (name == "torque-ripple") return {{a}, {b * std::cos(c), b * std::sin(c)}};
  // The rest, by what its class says of its parameters.
  const EffectTraits& traits = kDriveEffectTraits[s.effect];
  Place p;
  double linear = 1;
  for (std::size_t k = 0; k < kMaxEffectParameters; ++k) switch (traits.search[k].role) {
      case EffectRole::linear:
        p.coefficients.push_back(linear = s.scalar(k));
        break;
      case EffectRole::searched:
        p.theta.push_back(s.scalar(k));
        break;
      case EffectRole::amplitude:
        for (std::size_t q = 0; q < kMaxEffectParameters; ++q)
          if (traits.search[q].role == EffectRole::phase) {
            p.coefficients.push_back(s.scalar(k) * std::cos(s.scalar(q)));
            p.coefficients.push_back(s.scalar(k) * std::sin(s.scalar(q)));
          }
        break;
      case EffectRole::offset:
        p.coefficients.push_back(-linear * s.scalar(k));
        break;
      default:
        break;
    }
  if (traits.sized) p.coefficients = {1};
  return p;
}

void compare(catalogue::Machine m, const Trajectory& motion, const catalogue::Values& values,
             const char* effect, double plain_rms) {
  const EffectSetting setting = catalogue::setting(effect, values);
  catalogue::hide(m, setting);
  DriveData data = catalogue::record(m, motion);
  const DriveModelConfig model = data.model;
  const DriveSignals signals(data, kCorner_hz);
  const Column expected = signals.to_rows(signals.to_work(residual_of(data, model)));
  const double size = rms(expected, signals.usable);

  const Column whole = signals.response(setting, model);
  CHECK(whole.size() == expected.size());
  if (whole.size() != expected.size()) return;
  const double error = rms(less(expected, whole), signals.usable) / size;

  DriveSituation situation;
  situation.data = &data;
  situation.signals = std::make_shared<DriveSignals>(signals);
  situation.model = situation.acting = model;
  situation.top_speed = situation.top_current_A = 1;
  situation.duration_s = motion.duration_s();
  situation.travel = 1;
  situation.low = 0;
  situation.high = setting.parameters[0].value[2];  // of a profile
  situation.timing_open = true;
  double as_candidate = 0;
  bool looked_for = false;
  for (const Candidate& c : drive_candidates(situation)) {
    if (c.name != effect) continue;
    const Place place = place_of(setting, model);
    const std::vector<Column> columns = c.columns(place.theta);
    if (columns.empty()) continue;
    looked_for = true;
    CHECK(columns.size() == place.coefficients.size());
    Column left = expected;
    for (std::size_t k = 0; k < columns.size() && k < place.coefficients.size(); ++k)
      left = less(std::move(left), columns[k], place.coefficients[k]);
    as_candidate = rms(left, signals.usable) / size;
    // And the way back: what the fit would report is what was hidden.
    const Meaning meaning = c.meaning(place.theta, place.coefficients);
    CHECK_TEXT(meaning.violation, "");
    const EffectSetting back = setting_of(effect, meaning, data.turns());
    for (std::size_t p = 0; p < kDriveEffects[setting.effect].parameter_count(); ++p)
      for (std::size_t k = 0; k < setting.parameters[p].count; ++k)
        CHECK_NEAR(back.parameters[p].value[k], setting.parameters[p].value[k],
                   1e-9 * std::abs(setting.parameters[p].value[k]));
  }
  std::printf("  %-8s %-28s %9.4g %s, column off by %6.3f %%\n", data.turns() ? "spindle" : "axis",
              effect, size, data.turns() ? "Nm" : "N", 100 * error);
  CHECK(size > 100 * plain_rms);  // there is something to see
  const bool load_rubs = std::string(effect) == "flexible-coupling" && setting.scalar(3) > 0;
  CHECK(error <= bound(effect, load_rubs));
  CHECK(as_candidate <= bound(effect, load_rubs));
  // Of the forces alone nobody looks for it: drive/views/scale.hpp.
  CHECK(looked_for == (std::string(effect) != "lead-error"));
}

}  // namespace

int main() {
  for (const bool turns : {false, true}) {
    catalogue::Machine m = turns ? catalogue::spindle(1) : catalogue::axis(1);
    const Trajectory motion = turns ? catalogue::spindle_motion() : catalogue::axis_motion();
    m.known = m.truth.drive;
    m.truth.sample_period_s = 125e-6;
    m.truth.current_noise_A = 0;
    m.truth.encoder.counts_per_turn = 1 << 28;
    const DriveData plain = catalogue::record(m, motion);
    const DriveSignals signals(plain, kCorner_hz);
    const double left =
        rms(signals.to_rows(signals.to_work(residual_of(plain, m.known))), signals.usable);
    for (const EffectInfo& info : kDriveEffects) {
      const catalogue::Case* c = catalogue::find(info.name);
      CHECK(c != nullptr);
      if (c == nullptr || (turns ? c->spindle : c->axis).empty()) continue;
      compare(m, motion, turns ? c->spindle : c->axis, info.name, left);
    }
  }
  return check::done();
}
