#include "reconcile/drive/views/scale.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <utility>

#include "reconcile/drive/backlash_response.hpp"
#include "reconcile/numerics/least_squares.hpp"
#include "reconcile/numerics/whole_orders.hpp"
#include "reconcile/select/search.hpp"
#include "servosense/core/units.hpp"
#include "servosense/reconcile/decide.hpp"

namespace servosense::reconcile {
namespace {

constexpr int kMostOrders = 8;        // of a turn: ball passes and coupling lie within
constexpr std::size_t kWindup = 1;    // of the known terms, behind the zero
constexpr double kTurnsPassed = 1.5;  // fewer of a turn: a line of it is a slope, or none

/// Orders of a turn that carry the residual, strongest first, one after the other beside a slope.
std::vector<double> orders_of(const Column& residual, const DriveSituation& s,
                              const Column& turn_phase) {
  std::vector<std::size_t> rows;
  for (std::size_t i = 0; i < residual.size(); ++i)
    if (s.signals->usable[i]) rows.push_back(i);
  const auto n = static_cast<Eigen::Index>(rows.size());
  if (n < 100) return {};
  Eigen::MatrixXd all(n, 2 + 2 * kMostOrders);
  Eigen::VectorXd y(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const std::size_t row = rows[static_cast<std::size_t>(i)];
    y(i) = residual[row];
    all(i, 0) = 1;
    all(i, 1) = s.signals->position_rows[row];
    for (Eigen::Index k = 1; k <= kMostOrders; ++k) {
      const double phase = static_cast<double>(k) * turn_phase[row];
      all(i, 2 * k) = std::sin(phase);
      all(i, 2 * k + 1) = std::cos(phase);
    }
  }
  const Eigen::MatrixXd gram = all.transpose() * all;
  WholeOrders found(gram, all.transpose() * y, 2);
  std::vector<double> orders;
  while (orders.size() < 3) {
    const WholeOrders::Next next = found.next();
    if (!(next.more > s.criteria->order_share * (y.squaredNorm() - found.explained()))) break;
    orders.push_back(next.order);
    found.add(next.order);
  }
  return orders;
}

/// A sine of the motor's turn, through the filter of the rows.
Column cyclic(const DriveSituation& s, double order, double phase, double rad_per_unit) {
  Column error = s.signals->position;
  for (double& x : error) x = std::sin(order * rad_per_unit * x + phase);
  return s.signals->driven_to_rows(error);
}

/// `sprung`: a slope would be windup, and only lines of a turn are a lead error for sure.
Candidate lead_error(const DriveSituation& s, bool sprung) {
  Candidate c;
  const std::size_t effect = drive_effect_index("lead-error");
  const EffectTraits& traits = kDriveEffectTraits[effect];
  c.name = "lead-error";
  c.scope = "power-up";  // the phase: an encoder may count from elsewhere
  c.where = traits.where;
  c.splitting_motion = "the whole stroke, slowly, both ways";
  const double unit = s.model.unit_per_turn;
  Column phase = s.signals->position_rows;
  const double start = s.signals->turn_angle.empty() ? 0 : s.signals->turn_angle[0];
  for (double& x : phase) x = start + (unit > 0 ? kTwoPi / unit * x : 0);
  // Theta: whole orders, as they are; order 0 stands for the slope alone.
  const double least = sprung ? 1 : 0;
  c.search = {{least, least, 1, false}};
  c.starts = [s, phase, unit, sprung](const Column& residual) {
    std::vector<std::vector<double>> all;
    if (!sprung) all.push_back({0.0});
    if (unit > 0 && s.travel > kTurnsPassed * unit)
      if (std::vector<double> orders = orders_of(residual, s, phase); !orders.empty())
        all.push_back(std::move(orders));
    return all;
  };
  c.columns = [s, start, unit, sprung](std::span<const double> theta) {
    std::vector<Column> out;
    if (!sprung) out.push_back(s.signals->position_rows);
    for (const double order : theta) {
      if (!(order > 0) || !(unit > 0)) continue;
      out.push_back(cyclic(s, order, order * start, kTwoPi / unit));
      out.push_back(cyclic(s, order, order * start + kTwoPi / 4, kTwoPi / unit));
    }
    return out;
  };
  c.meaning = [sprung](std::span<const double> theta, std::span<const double> coefficients) {
    Meaning m;
    m.parameters = {{"amplitude_m", {}, {}},
                    {"order", {}, {}},
                    {"slope", {sprung ? 0 : coefficients[0]}, {}},
                    {"phase_rad", {}, {}}};
    std::size_t at = sprung ? 0 : 1;
    for (const double order : theta) {
      if (!(order > 0) || at + 1 >= coefficients.size()) continue;
      const double sine = coefficients[at++], cosine = coefficients[at++];
      m.parameters[0].values.push_back(std::hypot(sine, cosine));
      m.parameters[1].values.push_back(order);
      m.parameters[3].values.push_back(std::atan2(cosine, sine));
    }
    if (m.parameters[1].values.empty()) {
      m.parameters[0].values = {0};
      m.parameters[1].values = {1};
      m.parameters[3].values = {0};
    }
    return m;
  };
  return c;
}

/// Backlash while friction holds the stage: the motor crosses the gap alone. Widths of a multiple
/// of `windup` are for sure none of it.
Candidate backlash(const DriveSituation& s, double windup) {
  Candidate c;
  const std::size_t effect = drive_effect_index("backlash");
  const EffectTraits& traits = kDriveEffectTraits[effect];
  c.name = "backlash";
  c.where = "travel-since-reversal";
  c.splitting_motion = traits.splitting_motion;
  c.sized = true;
  c.memory = true;
  const double presliding = usual_presliding(s.data->model, s.data->channel);
  c.search = {{0.2 * presliding, 200 * presliding, 24, true}};
  c.columns = [s](std::span<const double> theta) {
    Column lost = s.signals->driven_to_rows(s.signals->direction(0.5 * theta[0]));
    for (double& x : lost) x *= -0.5 * theta[0];
    return std::vector<Column>{std::move(lost)};
  };
  c.meaning = [least = s.criteria->windup_of_backlash * windup,
               key = kDriveEffects[effect].parameters[0].key_for(s.data->turns())](
                  std::span<const double> theta, std::span<const double>) {
    Meaning m;
    m.parameters = {{key, {theta[0]}, {}}};
    if (!(theta[0] > least)) m.violation = "friction winds the drive up by as much";
    return m;
  };
  return c;
}

/// Of the acceleration [rad2/s2].
double mean_square_frequency(const Problem& p, const Column& acceleration) {
  double changes = 0, squares = 0;
  for (std::size_t i = 1; i < p.rows(); ++i) {
    if (!p.usable[i] || !p.usable[i - 1]) continue;
    const double change = (acceleration[i] - acceleration[i - 1]) / p.row_period_s;
    changes += change * change;
    squares += acceleration[i] * acceleration[i];
  }
  return squares > 0 ? changes / squares : 0;
}

/// By what accelerates the load, whatever share of the friction it has: `lost` is its backlash.
void add_compliance(BetweenEncoders& between, Problem p, const DriveSituation& s,
                    const FitRows& rows, const std::vector<Column>& lost) {
  constexpr double kShown = 3;  // standard errors
  const double inertia = s.model.inertia;
  Column mass = s.signals->acceleration_rows, friction = p.known[kWindup].column;
  for (std::size_t i = 0; i < mass.size(); ++i) {
    mass[i] *= inertia;
    friction[i] -= mass[i];
  }
  p.known[kWindup].column = std::move(mass);
  p.known.push_back({"windup", std::move(friction), 0, false});
  const Fit fit = regression_of_known(p, rows).fit_with(lost);
  const double c = -fit.coefficients(kWindup), error = fit.standard_errors(kWindup);
  if (!(c > kShown * error)) return;
  // The load swings after the motor: windup is that of a steady acceleration but for the square of
  // its frequency over that of the load, there and back.
  const double swings = 2 * mean_square_frequency(p, s.signals->acceleration_rows) * c * inertia;
  const double relative = std::hypot(error / c, swings);
  const double hz = std::sqrt(1 / (c * inertia)) / kTwoPi;
  between.compliance = Told{c, c * relative};
  between.held_resonance_hz = Told{hz, hz * relative / 2};
}

/// What the stage stays behind, both ways, beside a drive that all that it takes winds up.
LostMotion lost_motion_beside_windup(const Problem& p, const DriveSituation& s,
                                     const Options& options, BetweenEncoders& between) {
  const FitRows rows = fit_rows(p, options.blocks);
  Regression r = regression_of_known(p, rows);
  Candidate free = backlash(s, 0);
  free.sized = false;  // how soon a stage lets go of its flank says less of the gap than how far
  const Optimum found = search(free, r, {});
  const Fit fit = r.fit_with(found.columns);
  const double shape = found.theta[0];
  const Eigen::Index at = r.columns();
  // The stage's friction is as much of the drive's as its mass is, or not at all.
  const double windup = 2 * s.model.coulomb * std::abs(fit.coefficients(kWindup));
  // What the two sensors differ by beyond their steps is the same at every reversal: in full.
  const double left = root(fit.mean_square - p.encoder_floor * p.encoder_floor);
  const Eigen::VectorXd along = r.projected(found.columns[0]);
  const double misfit =
      left * std::sqrt(static_cast<double>(along.size())) / std::max(along.norm(), 1e-300);
  add_compliance(between, p, s, rows, found.columns);
  return LostMotion{shape * fit.coefficients(at),
                    std::hypot(shape * fit.standard_errors(at), shape * misfit, windup), windup};
}

/// Scale less motor position over the rows; nothing when they do not show the same motion.
std::optional<Problem> scale_problem(const DriveSituation& s, const Problem& forces,
                                     const SeenInForces& seen) {
  const DriveSignals& signals = *s.signals;
  if (s.data->load_position.size() != s.data->samples.size()) return {};
  Column scale = s.data->load_position;
  const double first = scale.front();
  for (double& x : scale) x -= first;
  Problem p;
  p.unit = s.data->turns() ? "rad" : "m";
  p.row_period_s = forces.row_period_s;
  p.noise_bandwidth_hz = forces.noise_bandwidth_hz;
  p.time_s = forces.time_s;
  p.usable = forces.usable;
  // A stage that brakes harder than its friction would lies on the other flank.
  const double hard = s.criteria->slowly * s.model.coulomb / s.model.inertia;
  for (std::size_t i = 0; i < p.usable.size(); ++i) {
    const double direction = signals.velocity_rows[i] < 0 ? -1 : 1;
    if (signals.acceleration_rows[i] * direction < -hard) p.usable[i] = false;
  }
  p.held_out = forces.held_out;
  p.coordinates = forces.coordinates;
  p.lap_rows = forces.lap_rows;
  // What the counter itself cannot tell is no fault of the screw.
  p.encoder_floor = std::abs(s.data->unit_per_count) / std::sqrt(12.0);
  p.target = signals.to_rows(signals.to_work(scale));
  double mean = 0, farthest = 0;
  std::size_t n = 0;
  for (std::size_t i = 0; i < p.rows(); ++i) {
    p.target[i] -= signals.position_rows[i];
    if (!p.usable[i]) continue;
    mean += p.target[i];
    ++n;
  }
  if (n == 0) return {};
  mean /= static_cast<double>(n);
  for (std::size_t i = 0; i < p.rows(); ++i) {
    p.target[i] -= mean;
    if (p.usable[i]) farthest = std::max(farthest, std::abs(p.target[i]));
  }
  if (!(farthest < s.criteria->same_motion * s.travel)) return {};
  p.known.push_back({"zero", Column(p.rows(), 1.0), 0, false});
  // The stage has as much of the drive's friction as of its mass, or somewhat more or less: so
  // that a constant lost motion is not windup.
  Column taken = signals.driven_to_rows(signals.direction(s.model.friction_knee));
  Column held = forces.target;
  for (std::size_t i = 0; i < taken.size(); ++i) {
    taken[i] = s.model.inertia * signals.acceleration_rows[i] +
               s.model.viscous * signals.velocity_rows[i] + s.model.coulomb * taken[i];
    held[i] -= taken[i];
  }
  p.known.push_back({"windup", std::move(taken), 0, false});
  // What else the motor holds may wind the stage up, too.
  p.known.push_back({"windup", std::move(held), 0, false});
  if (seen.sprung) p.known.push_back({"windup", signals.position_rows, 0, false});
  const auto add_line = [&](double order, double turn) {
    for (const double phase : {0.0, kTwoPi / 4})
      p.known.push_back({"encoder-eccentricity", cyclic(s, order, phase, kTwoPi / turn), 0, false});
  };
  const double turn = s.model.unit_per_turn, of_motor = s.data->motor_turn;
  if (s.data->turns()) {
    for (const double whole : {turn, of_motor == turn ? 0 : of_motor})
      if (whole > 0 && s.travel > kTurnsPassed * whole)
        for (const double order : {1.0, 2.0}) add_line(order, whole);
  } else if (seen.eccentric && turn > 0) {
    add_line(1, turn);
  }
  return p;
}

}  // namespace

std::optional<ScaleFindings> compare_scale(const DriveSituation& s, const Problem& forces,
                                           const SeenInForces& seen, const Options& options) {
  const std::optional<Problem> problem = scale_problem(s, forces, seen);
  if (!problem) return {};
  ScaleFindings found;
  const LostMotion lost = lost_motion_beside_windup(*problem, s, options, found.between);
  found.between.unit = problem->unit;
  // A stage that something pulls at lies on one flank both ways.
  if (loads_of(*s.signals, s.acting).empty()) {
    found.lost = lost;
    found.between.backlash = Told{lost.width, lost.error};
  }
  std::vector<Candidate> candidates;
  const bool has_lead = !s.data->turns() && s.data->model.effects.find("lead-error") == nullptr;
  if (has_lead) candidates.push_back(lead_error(s, seen.sprung));
  if (s.data->model.effects.find("backlash") == nullptr)
    candidates.push_back(backlash(s, lost.windup));
  if (candidates.empty()) return found;
  const Decision decision = decide(*problem, candidates, options);
  found.left = found.between.left = decision.report.gap_after;
  found.at_floor = decision.report.residual_white;
  for (std::size_t i = 0; i < decision.accepted.size(); ++i) {
    const Accepted& accepted = decision.accepted[i];
    const FoundEffect& effect = decision.report.effects[i];
    if (effect.name == "lead-error" && !found.at_floor &&
        effect.gap_after > s.criteria->lead_error_leaves * effect.gap_before) {
      found.left = effect.gap_before;
      break;
    }
    found.effects.push_back(effect);
    found.effects.back().gap_unit = problem->unit;
    found.settings.push_back(
        setting_of(candidates[accepted.candidate].name, accepted.meaning, s.data->turns()));
  }
  for (const NotTestable& n : decision.report.not_testable)
    if (n.name == "lead-error") found.not_testable.push_back(n);
  if (seen.sprung && has_lead)
    found.not_testable.push_back(
        {"lead-error",
         "the spring load winds the drive up in proportion to position, as a slope would",
         "the scale against the motor with the spring taken off"});
  return found;
}

}  // namespace servosense::reconcile
