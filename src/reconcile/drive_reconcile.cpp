#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

#include "drive_candidates.hpp"
#include "drive_signals.hpp"
#include "least_squares.hpp"
#include "servosense/core/units.hpp"
#include "servosense/identify/idle.hpp"
#include "servosense/reconcile/decide.hpp"
#include "servosense/reconcile/drive.hpp"

namespace servosense::reconcile {
namespace {

constexpr double kLeastTravelInKnees = 40;
constexpr double kLeastMotion_s = 2;
constexpr double kLargestModelError = 3;   // a factor; beyond it the file is of another machine
constexpr double kTimingSlack_s = 1.6e-4;  // the current loop of a healthy drive: 1 kHz

std::string printed(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.4g", value);
  return text;
}

/// Keys of the machine file for what the model has.
struct Keys {
  const char *inertia, *viscous, *coulomb;
};
Keys keys_of(bool turns) {
  return turns ? Keys{"inertia_kg_m2", "viscous_friction_Nm_s_per_rad", "coulomb_friction_Nm"}
               : Keys{"equivalent_mass_kg", "viscous_friction_N_s_per_m", "coulomb_friction_N"};
}

/// Rows after which the motion repeats, from the velocity; 0 when it does not.
std::size_t find_laps(const Column& velocity, std::size_t end, double row_period_s) {
  // Thinned out to some 40 Hz: laps last seconds.
  const auto stride = std::max<std::size_t>(1, static_cast<std::size_t>(0.025 / row_period_s));
  Column v;
  for (std::size_t i = 0; i < end; i += stride) v.push_back(velocity[i]);
  const std::size_t n = v.size();
  const auto mismatch = [](const Column& x, std::size_t lag, std::size_t to) {
    double difference = 0, power = 0;
    for (std::size_t i = 0; i + lag < to; ++i) {
      difference += (x[i] - x[i + lag]) * (x[i] - x[i + lag]);
      power += x[i] * x[i] + x[i + lag] * x[i + lag];
    }
    return power > 0 ? difference / power : 1.0;
  };
  const auto shortest =
      static_cast<std::size_t>(1.0 / (static_cast<double>(stride) * row_period_s));
  std::size_t best = 0;
  double least = 0.02;  // of the power: the same program, not a similar one
  for (std::size_t lag = shortest; lag + std::max(shortest, n / 6) < n; ++lag) {
    const double m = mismatch(v, lag, n);
    if (m < 0.8 * least) {
      least = m;
      best = lag;
    }
  }
  if (best == 0) return 0;
  std::size_t lap = best * stride;
  least = std::numeric_limits<double>::infinity();
  const std::size_t from = lap > stride ? lap - stride : 1;
  for (std::size_t lag = from; lag <= best * stride + stride; ++lag) {
    const double m = mismatch(velocity, lag, end);
    if (m < least) {
      least = m;
      lap = lag;
    }
  }
  return lap;
}

/// What the monitors' observer reads while nothing is cut: rms, and the largest value, below which
/// no threshold can lie.
std::vector<std::pair<std::string, double>> idle_reading(const DriveData& data,
                                                         const DriveModelConfig& model) {
  DisturbanceObserverConfig config = data.observer;
  config.sample_period_s = data.sample_period_s;
  config.drive = model;
  if (!DisturbanceObserver<double>::validate(config).ok()) return {};
  DriveRecord record{data.channel, data.sample_period_s, data.samples};
  const std::vector<bool> moving = samples_in_motion(config, record);
  DisturbanceObserver<double> observer;
  observer.configure(config);
  double square = 0, largest = 0;
  std::size_t n = 0;
  for (std::size_t i = 0; i < record.samples.size(); ++i) {
    const double estimate = observer.process(record.samples[i]);
    if (!moving[i]) continue;
    square += estimate * estimate;
    largest = std::max(largest, std::abs(estimate));
    ++n;
  }
  if (n == 0) return {};
  const std::string unit = data.turns() ? " [Nm]" : " [N]";
  return {{"estimated force while idling, rms" + unit, std::sqrt(square / static_cast<double>(n))},
          {"its largest value, the least threshold" + unit, largest}};
}

class DriveWorkflow {
 public:
  DriveWorkflow(const DriveData& data, const Options& options)
      : data_(data),
        options_(options),
        model_(data.model),
        signals_(data, comparison_corner(data)) {}

  Expected<DriveOutcome> run();

 private:
  [[nodiscard]] std::string who() const { return std::string(servosense::name_of(data_.channel)); }
  Expected<Done> check_motion();
  void set_up();
  Expected<Done> calibrate();
  void know(const char* name, Column column, double nominal, bool recalibrated) {
    if (std::find(idle_.begin(), idle_.end(), name) != idle_.end()) return;
    problem_.known.push_back({name, std::move(column), nominal, recalibrated});
  }
  void know_terms(bool with_coulomb = false);
  [[nodiscard]] Fit fit_known() const;
  void drop_idle_terms();
  void add_coordinates();
  [[nodiscard]] DriveSituation situation() const;
  [[nodiscard]] double nominal_gap() const;

  const DriveData& data_;
  const Options& options_;
  DriveModelConfig model_;
  DriveSignals signals_;
  Problem problem_;
  std::vector<std::string> idle_;  // terms that are allowed for but not needed
  std::vector<Column> found_;      // effects of a first pass, while the calibration is repeated
  bool presliding_found_ = false;
  bool timing_found_ = false;  // one of them is a delay or a lag
  double delay_s_ = 0;         // of the effort, as far as it is a nuisance
  double late_s_ = 0;          // as fitted
  bool timing_open_ = false;
  double top_speed_ = 0;
  bool constant_known_ = false;
};

Expected<Done> DriveWorkflow::check_motion() {
  const auto [low, high] = std::minmax_element(signals_.position.begin(), signals_.position.end());
  const double travel = *high - *low;
  const char* unit = data_.turns() ? " rad" : " m";
  if (!(travel > kLeastTravelInKnees * model_.friction_knee))
    return data_error(who() + ": the drive does not move (" + printed(travel) + unit +
                      " in all); record it moving without cutting, at several speeds in both "
                      "directions");
  std::size_t moving = 0, forward = 0;
  for (std::size_t i = 0; i < signals_.usable.size(); ++i) {
    if (!signals_.usable[i]) continue;
    ++moving;
    if (signals_.velocity_rows[i] > 0) ++forward;
    top_speed_ = std::max(top_speed_, std::abs(signals_.velocity_rows[i]));
  }
  const double motion_s = static_cast<double>(moving) * signals_.row_period_s();
  if (motion_s < kLeastMotion_s)
    return data_error(who() + ": only " + printed(motion_s) +
                      " s of usable motion; record at least 10 s at several speeds in both "
                      "directions");
  const double share = static_cast<double>(forward) / static_cast<double>(moving);
  if (!data_.turns() && !(share > 0.02 && share < 0.98))
    return data_error(who() +
                      ": the record moves one way only, so friction, loads and most other "
                      "effects look alike; record moves in both directions");
  return Done{};
}

void DriveWorkflow::know_terms(bool with_coulomb) {
  problem_.known.clear();
  const Keys keys = keys_of(data_.turns());
  know(keys.inertia, signals_.acceleration_rows, data_.model.inertia, true);
  if (data_.model.viscous > 0)
    know(keys.viscous, signals_.velocity_rows, data_.model.viscous, true);
  if (data_.model.coulomb > 0 || with_coulomb) {
    const Column sign = signals_.to_rows(signals_.direction(model_.friction_knee));
    know(keys.coulomb, sign, data_.model.coulomb, true);
  }
  {
    // The way friction swings over within the knee: laws differ, and none is to be named for it.
    if (!presliding_found_) {
      EffectSetting bristle;
      bristle.effect = drive_effect_index("presliding-hysteresis");
      bristle.parameters[0] = {{1 / model_.friction_knee}, 1};
      bristle.parameters[1] = {{1.0}, 1};
      know("knee shape", signals_.response(bristle, model_), 0, false);
    }
  }
  // Every machine has a mode above the band; its foot within the band is not to be named.
  if (data_.model.effects.find("flexible-coupling") == nullptr) {
    EffectSetting mode;
    mode.effect = drive_effect_index("flexible-coupling");
    mode.parameters[0] = {{4 * signals_.corner_hz}, 1};
    mode.parameters[1] = {{0.05}, 1};
    mode.parameters[2] = {{0.5}, 1};
    know("stiff mode", signals_.response(mode, model_), 0, false);
  }
  if (constant_known_) know("constant load", Column(signals_.rows(), 1.0), 0, false);
  for (std::size_t i = 0; i < data_.model.effects.count; ++i) {
    const EffectSetting& s = data_.model.effects.settings[i];
    if (s.effect == drive_effect_index("constant-load")) continue;
    Column column = signals_.response(s, data_.model);
    if (!column.empty()) know(kDriveEffects[s.effect].name, std::move(column), 1, false);
  }
  for (const Column& column : found_) know("found", column, 0, false);
  if (!timing_open_) {
    Column later = signals_.effort_rows(delay_s_ + 0.5e-3);
    const Column sooner = signals_.effort_rows(delay_s_ - 0.5e-3);
    for (std::size_t i = 0; i < later.size(); ++i) later[i] = (sooner[i] - later[i]) * 1e3;
    know("timing", std::move(later), 0, false);
  }
}

Fit DriveWorkflow::fit_known() const {
  const FitRows rows = fit_rows(problem_, options_.blocks);
  Regression r(rows, problem_.target);
  for (const KnownTerm& term : problem_.known) r.add(term.column);
  return r.fit();
}

/// A shape that is allowed for but does not pay on rows left out would only do harm there.
void DriveWorkflow::drop_idle_terms() {
  idle_.clear();
  for (const char* name : {"stiff mode", "knee shape"}) {
    know_terms();
    const double with = fit_known().loss;
    idle_.emplace_back(name);
    know_terms();
    if (!(fit_known().loss < with)) idle_.pop_back();
  }
  know_terms();
}

void DriveWorkflow::set_up() {
  problem_.unit = data_.turns() ? "Nm" : "N";
  problem_.row_period_s = signals_.row_period_s();
  problem_.noise_bandwidth_hz = signals_.corner_hz;
  problem_.usable = signals_.usable;
  problem_.usable.resize(signals_.rows(), false);
  const std::size_t n = signals_.rows();
  problem_.held_out.assign(n, false);
  const auto split =
      static_cast<std::size_t>((1 - options_.held_out_share) * static_cast<double>(n));
  for (std::size_t i = 0; i < n; ++i) {
    problem_.time_s.push_back(data_.start_s + static_cast<double>(i) * problem_.row_period_s);
    problem_.held_out[i] = i >= split;
  }
  problem_.target = signals_.effort_rows(0);
  problem_.lap_rows = find_laps(signals_.velocity_rows, split, problem_.row_period_s);
  const DriveEffectsConfig& effects = data_.model.effects;
  constant_known_ = data_.model.constant_load != 0 || effects.find("constant-load") != nullptr;
}

/// Stage 2: the knee, the timing and what the model has.
Expected<Done> DriveWorkflow::calibrate() {
  idle_.clear();
  // The knee first: friction laws differ in it, and nothing is to be named for that.
  // With Coulomb friction even where the model has none: if it is missing, its knee is known then.
  {
    const double given = data_.model.friction_knee;
    const double widest = 2 * std::max(given, data_.turns() ? 1e-3 : 5e-6);
    const double narrowest = std::max(widest / 20, 2 * std::abs(data_.unit_per_count));
    double best = given, least = std::numeric_limits<double>::infinity();
    const auto consider = [&](double knee) {
      if (!(knee >= narrowest && knee <= 1.001 * widest)) return;
      model_.friction_knee = knee;
      know_terms(true);
      const double square = fit_known().mean_square;
      if (square < least) {
        least = square;
        best = knee;
      }
    };
    for (double knee = widest; knee >= narrowest; knee /= 1.5) consider(knee);
    for (double step = 1.22; step > 1.02; step = std::sqrt(step)) {
      const double middle = best;
      consider(middle * step);
      consider(middle / step);
    }
    model_.friction_knee = best;
  }
  // Then the time by which the effort is late.
  const double bound = data_.expected_lag_s + data_.servo_period_s + kTimingSlack_s;
  timing_open_ = timing_found_;
  for (int round = 0; round < 3 && !timing_found_; ++round) {
    problem_.target = signals_.effort_rows(delay_s_);
    know_terms();
    const Fit fit = fit_known();
    const double late = fit.coefficients(fit.coefficients.size() - 1);
    delay_s_ = std::clamp(delay_s_ + late, -0.01, 0.01);
  }
  if (!timing_found_) {
    late_s_ = delay_s_;
    timing_open_ = std::abs(delay_s_) > bound;
  }
  if (timing_open_) delay_s_ = 0;
  problem_.target = signals_.effort_rows(delay_s_);
  drop_idle_terms();
  const Fit fit = fit_known();
  std::size_t at = 0;
  for (const KnownTerm& term : problem_.known) {
    const double value = fit.coefficients(static_cast<Eigen::Index>(at++));
    const Keys keys = keys_of(data_.turns());
    if (term.name == keys.inertia) model_.inertia = value;
    if (term.name == keys.viscous) model_.viscous = std::max(0.0, value);
    if (term.name == keys.coulomb) model_.coulomb = std::max(0.0, value);
    if (term.name == "constant load") model_.constant_load = value;
  }
  const double ratio = model_.inertia / data_.model.inertia;
  if (!(ratio > 0))
    return data_error(who() + ": the effort does not accelerate the drive (fitted " +
                      keys_of(data_.turns()).inertia + " " + printed(model_.inertia) +
                      "); check the sign of the effort column and record harder accelerations");
  if (!(ratio < kLargestModelError && ratio > 1 / kLargestModelError))
    return data_error(who() + ": the trace asks for " + keys_of(data_.turns()).inertia + " = " +
                      printed(model_.inertia) + ", the machine file says " +
                      printed(data_.model.inertia) +
                      "; check it, the lead, the encoder and the force constant, or let "
                      "'servosense identify idle' find them");
  return Done{};
}

void DriveWorkflow::add_coordinates() {
  const Column direction = signals_.to_rows(signals_.direction(model_.friction_knee));
  const auto add = [&](const char* name, const char* unit, Column values, Column factor = {},
                       double period = 0) {
    problem_.coordinates.push_back({name, unit, std::move(values), std::move(factor), period, 24});
  };
  const char* length = data_.turns() ? "rad" : "m";
  add("velocity", data_.turns() ? "rad/s" : "m/s", signals_.velocity_rows);
  add("position", length, signals_.position_rows);
  add("position-and-direction", length, signals_.position_rows, direction);
  add("time", "s", problem_.time_s);
  add("time-and-direction", "s", problem_.time_s, direction);
  add("acceleration", data_.turns() ? "rad/s2" : "m/s2", signals_.acceleration_rows);
  if (model_.unit_per_turn > 0) {
    Column angle = signals_.position_rows;
    for (double& x : angle) x *= kTwoPi / model_.unit_per_turn;
    add("motor-angle", "rad", std::move(angle), {}, kTwoPi);
  }
  Column since(signals_.rows(), 0);
  double turned = 0;
  int sign = 0;
  for (std::size_t i = 0; i < since.size(); ++i) {
    const double v = signals_.velocity_rows[i];
    const double x = signals_.position_rows[i];
    const int now = v > 0 ? 1 : v < 0 ? -1 : sign;
    if (now != sign) turned = x;
    sign = now;
    since[i] = std::abs(x - turned);
  }
  add("travel-since-reversal", length, since, direction);
}

double DriveWorkflow::nominal_gap() const {
  const Keys keys = keys_of(data_.turns());
  Column r = signals_.effort_rows(0);
  const auto subtract = [&](double c, const Column& column) {
    for (std::size_t i = 0; i < r.size(); ++i) r[i] -= c * column[i];
  };
  double load = data_.model.constant_load;
  if (const EffectSetting* s = data_.model.effects.find("constant-load")) load += s->scalar(0);
  for (const KnownTerm& term : problem_.known) {
    if (term.name == keys.coulomb)
      subtract(term.nominal, signals_.to_rows(signals_.direction(data_.model.friction_knee)));
    else
      subtract(term.nominal, term.column);
  }
  double square = 0;
  std::size_t n = 0;
  for (std::size_t i = 0; i < r.size(); ++i)
    if (problem_.usable[i] && problem_.held_out[i]) {
      square += (r[i] - load) * (r[i] - load);
      ++n;
    }
  return n > 0 ? std::sqrt(square / static_cast<double>(n)) : 0;
}

DriveSituation DriveWorkflow::situation() const {
  DriveSituation s;
  s.data = &data_;
  s.signals = &signals_;
  s.model = model_;
  s.top_speed = top_speed_;
  s.duration_s = problem_.time_s.back() - problem_.time_s.front();
  const auto [low, high] = std::minmax_element(signals_.position.begin(), signals_.position.end());
  s.travel = *high - *low;
  s.low = std::numeric_limits<double>::infinity();
  s.high = -s.low;
  for (std::size_t i = 0; i < problem_.rows(); ++i)
    if (problem_.usable[i] && !problem_.held_out[i]) {
      s.low = std::min(s.low, signals_.position_rows[i]);
      s.high = std::max(s.high, signals_.position_rows[i]);
    }
  s.constant_known = constant_known_;
  s.timing_open = timing_open_;
  return s;
}

Expected<DriveOutcome> DriveWorkflow::run() {
  if (auto ok = check_motion(); !ok) return ok.error();
  set_up();
  if (auto ok = calibrate(); !ok) return ok.error();
  add_coordinates();

  std::vector<Candidate> candidates = drive_candidates(situation());
  Decision decision = decide(problem_, candidates, options_);
  if (!decision.accepted.empty()) {
    // Knee, timing and inertia were found without these effects: once more with them.
    for (const Accepted& accepted : decision.accepted) {
      const std::string& name = candidates[accepted.candidate].name;
      timing_found_ = timing_found_ || name == "transport-delay" || name == "current-loop-lag";
      presliding_found_ = presliding_found_ || name == "presliding-hysteresis";
      for (Column& column : candidates[accepted.candidate].columns(accepted.theta))
        found_.push_back(std::move(column));
    }
    if (auto ok = calibrate(); !ok) return ok.error();
    found_.clear();
    know_terms();
    candidates = drive_candidates(situation());
    decision = decide(problem_, candidates, options_);
  }

  DriveOutcome outcome;
  outcome.report = decision.report;
  outcome.report.channel = who();
  outcome.report.gap_nominal = nominal_gap();
  outcome.report.timing_s = late_s_;
  outcome.report.remarks = data_.remarks;
  outcome.model = data_.model;
  std::size_t at = 0;
  const Keys keys = keys_of(data_.turns());
  for (const KnownTerm& term : problem_.known) {
    const double value = decision.known[at++];
    if (term.name == keys.inertia) outcome.model.inertia = value;
    if (term.name == keys.viscous) outcome.model.viscous = std::max(0.0, value);
    if (term.name == keys.coulomb) {
      outcome.model.coulomb = std::max(0.0, value);
      outcome.model.friction_knee = model_.friction_knee;
    }
  }
  for (const Accepted& accepted : decision.accepted) {
    const std::string& name = candidates[accepted.candidate].name;
    if (drive_effect_index(name) == kDriveEffectCount) continue;
    outcome.added.push_back(setting_of(name, accepted.meaning, data_.turns()));
    if (outcome.model.effects.count < kMaxActiveEffects)
      outcome.model.effects.settings[outcome.model.effects.count++] = outcome.added.back();
  }
  outcome.report.monitors_before = idle_reading(data_, data_.model);
  outcome.report.monitors_after = idle_reading(data_, outcome.model);
  if (outcome.report.monitors_after.empty()) outcome.report.monitors_before.clear();
  outcome.report.summary = summary_of(outcome.report, who());
  return outcome;
}

}  // namespace

Expected<DriveOutcome> reconcile_drive(const DriveData& data, const Options& options) {
  if (data.samples.size() < 100)
    return data_error(std::string(servosense::name_of(data.channel)) + ": only " +
                      std::to_string(data.samples.size()) +
                      " samples; record at least 10 s of motion without cutting");
  return DriveWorkflow(data, options).run();
}

void augment(MachineFile& machine, const DriveOutcome& outcome, const std::string& provenance) {
  const Report& r = outcome.report;
  const bool turns = r.channel == "spindle";
  const Keys keys = keys_of(turns);
  const std::string section = turns ? "spindle" : "axis." + r.channel;
  const auto rounded = [](double v) {
    char text[40];
    std::snprintf(text, sizeof text, "%.8g", v);
    return std::strtod(text, nullptr);
  };
  for (const Recalibrated& c : r.recalibrated) {
    char note[64];
    std::snprintf(note, sizeof note, "+- %.3g (standard error)", c.standard_error);
    if (c.parameter == keys.inertia || c.parameter == keys.viscous || c.parameter == keys.coulomb)
      machine.set(section, c.parameter, rounded(std::max(0.0, c.to)), note);
  }
  if (machine.number(section, keys.coulomb).value_or(0) > 0)
    machine.set(section, turns ? "friction_knee_rad" : "friction_knee_m",
                rounded(outcome.model.friction_knee));
  for (const FoundEffect& e : r.effects) {
    const std::string name = "effect." + r.channel + "." + e.name;
    for (std::size_t p = 0; p < e.parameters.size(); ++p) {
      const NamedValue& v = e.parameters[p];
      if (!v.text.empty()) {
        machine.set(name, v.key, v.text);
      } else if (v.key == "profile") {
        std::vector<std::array<double, 2>> pairs;
        for (std::size_t k = 0; k + 1 < v.values.size(); k += 2)
          pairs.push_back({rounded(v.values[k]), rounded(v.values[k + 1])});
        machine.set(name, v.key, std::span<const std::array<double, 2>>(pairs));
      } else if (v.values.size() == 1) {
        char note[64];
        std::snprintf(note, sizeof note, "+- %.3g (standard error)",
                      p < e.standard_errors.size() ? e.standard_errors[p].values[0] : 0.0);
        machine.set(name, v.key, rounded(v.values[0]), note);
      } else {
        std::vector<double> values;
        for (const double x : v.values) values.push_back(rounded(x));
        machine.set(name, v.key, std::span<const double>(values));
      }
    }
    machine.set(name, "provenance",
                provenance + ", confidence " + printed(e.confidence) + ", gap " +
                    printed(e.gap_before) + " to " + printed(e.gap_after) + " " + r.gap_unit);
  }
}

}  // namespace servosense::reconcile
