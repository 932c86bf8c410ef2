#include "reconcile/cut/fit.hpp"

#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>
#include <tuple>
#include <utility>

#include "dsp/dense.hpp"
#include "reconcile/numerics/levenberg_marquardt.hpp"
#include "servosense/core/units.hpp"

namespace servosense::reconcile {
namespace {

using enum Unknown::Kind;

constexpr double kInstant = 1e-4;  // rad: the turn of a sample that is a value
constexpr int kFitRounds = 12;
constexpr int kFirstRounds = 4;       // of each start, to find the one that leads to the least
constexpr double kUnknown = 1e9;      // rad: a zero that nothing tells
constexpr int kScan = 10;             // to either side
constexpr double kFitSettled = 1e-6;  // relative change of the loss

}  // namespace

struct CutFitter::Trial {
  std::vector<double> values;
  CutState state;
  std::vector<Eigen::MatrixXd> columns;  // of the levels
  Eigen::VectorXd coefficients;
  Eigen::VectorXd residual;  // weighted, all levels
  double loss = std::numeric_limits<double>::infinity();
};

CutFitter::CutFitter(const CutAverage& average, CutState given, double feed_m,
                     const Criteria& criteria)
    : average_(average), given_(std::move(given)), feed_m_(feed_m), criteria_(criteria) {
  refresh();
}

void CutFitter::refresh() {
  mean_.resize(average_.levels.size());
  weight_.resize(average_.levels.size());
  for (std::size_t l = 0; l < mean_.size(); ++l)
    std::tie(mean_[l], weight_[l]) = average_.mean_of(l, false);
}

CutFitter::Trial CutFitter::evaluate(const std::vector<Unknown>& unknowns,
                                     const std::vector<double>& values, bool edges,
                                     const CutState& about, const Trial* alike) const {
  Trial t;
  t.values = values;
  t.state = state_at(unknowns, values, edges);
  t.state.coefficients = about.coefficients;
  t.state.blur_rad = about.blur_rad;
  t.state.cut.regeneration = about.cut.regeneration;
  t.state.sign_x = about.sign_x;
  t.state.sign_y = about.sign_y;
  const Eigen::Index n = t.state.columns();
  const auto rows = static_cast<Eigen::Index>(2 * average_.bins);
  const Eigen::VectorXd offset = offset_of(t.state);
  Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(n, n);
  Eigen::VectorXd right = Eigen::VectorXd::Zero(n);
  for (std::size_t l = 0; l < average_.levels.size(); ++l) {
    t.columns.push_back(alike != nullptr ? alike->columns[l]
                                         : columns_over_bins(t.state, average_.levels[l]));
    const Eigen::MatrixXd weighted = weight_[l].asDiagonal() * t.columns[l];
    normal += t.columns[l].transpose() * weighted;
    right += weighted.transpose() * (mean_[l] - offset);
  }
  t.coefficients = dense::solve_symmetric(normal, right);
  // Edges that the file has may be sharper than it says, but none pulls.
  for (int pulls = 0; pulls < 2 && given_.edges && t.coefficients(0) > 0; ++pulls) {
    const Eigen::Index edge = t.coefficients(2) < t.coefficients(3) ? 2 : 3;
    if (!(t.coefficients(edge) < 0)) break;
    normal.row(edge).setZero();
    normal.col(edge).setZero();
    normal(edge, edge) = 1;
    right(edge) = 0;
    t.coefficients = dense::solve_symmetric(normal, right);
    t.coefficients(edge) = 0;
  }
  if (!t.coefficients.allFinite()) t.coefficients.setZero();
  for (Eigen::Index c = 0; c < n; ++c)
    t.state.coefficients[static_cast<std::size_t>(c)] = t.coefficients(c);
  t.residual.resize(rows * static_cast<Eigen::Index>(average_.levels.size()));
  for (std::size_t l = 0; l < average_.levels.size(); ++l)
    t.residual.segment(static_cast<Eigen::Index>(l) * rows, rows) =
        (mean_[l] - offset - t.columns[l] * t.coefficients).cwiseProduct(weight_[l].cwiseSqrt());
  t.loss = t.residual.squaredNorm();
  if (!std::isfinite(t.loss)) t.loss = std::numeric_limits<double>::infinity();
  return t;
}

/// Straight teeth step within a bin: then each of its parts by itself.
Eigen::MatrixXd CutFitter::columns_over_bins(const CutState& state, const CutLevel& level) const {
  if (!steps_in(state))
    return force_columns(state, level.feed_per_tooth_m, level.speed_rad_s, level.angles.means());
  const BinnedAngles::Parts parts = level.angles.cut_at(breaks_of(state));
  return parts.over_bins(
      force_columns(state, level.feed_per_tooth_m, level.speed_rad_s, parts.angle_rad),
      static_cast<Eigen::Index>(average_.bins));
}

/// Over the bins of a level.
Eigen::VectorXd CutFitter::offset_of(const CutState& state) const {
  const auto bins = static_cast<Eigen::Index>(average_.bins);
  Eigen::VectorXd out(2 * bins);
  out << Eigen::VectorXd::Constant(bins, state.offset_N[0]),
      Eigen::VectorXd::Constant(bins, state.offset_N[1]);
  return out;
}

/// The linear coefficients are projected out.
void CutFitter::descend(Trial& best, const std::vector<Unknown>& unknowns, bool edges,
                        int rounds) const {
  if (unknowns.empty()) return;
  std::vector<BoundedParameter> parameters;
  for (const Unknown& u : unknowns) {
    // A step that moves by less than samples lie apart changes nothing.
    const bool moves_steps = steps_in(best.state) && (u.kind == zero || u.kind == pitch);
    parameters.push_back({u.low, u.high, moves_steps ? bin_rad() / 2 : u.small});
  }
  // An offset is no force of the teeth: their columns stay as they are.
  const auto same_teeth = [&](const std::vector<double>& a, const std::vector<double>& b) {
    for (std::size_t i = 0; i < unknowns.size(); ++i)
      if (a[i] != b[i] && unknowns[i].kind != offset_x && unknowns[i].kind != offset_y)
        return false;
    return true;
  };
  const CutState about = best.state;
  std::deque<Trial> last;
  const auto at = [&](const std::vector<double>& values) {
    for (const Trial& t : last)
      if (same_teeth(t.values, values)) return evaluate(unknowns, values, edges, about, &t);
    last.push_front(evaluate(unknowns, values, edges, about));
    if (last.size() > unknowns.size() + 2) last.pop_back();
    return last.front();
  };
  best = at(levenberg_marquardt([&](const auto& values) { return at(values).residual; },
                                best.values, parameters, rounds, kFitSettled)
                .values);
}

void CutFitter::refine(Trial& best, const std::vector<Unknown>& unknowns, bool edges,
                       double known_zero_rad) const {
  descend(best, unknowns, edges, kFitRounds);
  if (!steps_in(best.state) || unknowns.empty() || unknowns[0].kind != zero) return;
  // Slopes do not tell between which two samples teeth enter. Where the zero stays, that is known.
  const double moved_rad = std::abs(best.values[0] - known_zero_rad);
  bool found = false;
  for (const double step : {bin_rad() / 8, bin_rad() / 64, bin_rad() / 512}) {
    if (moved_rad < step) continue;
    const Trial middle = best;
    for (int k = -kScan; k <= kScan; ++k) {
      std::vector<double> values = middle.values;
      values[0] += k * step;
      Trial t = evaluate(unknowns, values, edges, middle.state);
      if (!(t.loss < best.loss)) continue;
      best = std::move(t);
      found = true;
    }
  }
  if (found) descend(best, unknowns, edges, kFitRounds);
}

std::vector<Eigen::VectorXd> CutFitter::forces(const CutState& state) const {
  std::vector<Eigen::VectorXd> out;
  const Eigen::Map<const Eigen::Vector4d> c(state.coefficients.data());
  for (const CutLevel& level : average_.levels)
    out.push_back(columns_over_bins(state, level) * c.head(state.columns()) + offset_of(state));
  return out;
}

CutFit CutFitter::finished(const Trial& trial, const std::vector<Unknown>& unknowns,
                           bool edges) const {
  CutFit f;
  f.unknowns = unknowns;
  f.values = trial.values;
  f.state = trial.state;
  for (std::size_t l = 0; l < average_.levels.size(); ++l)
    f.bins.push_back(trial.columns[l] * trial.coefficients + offset_of(trial.state));
  f.loss = 0;
  double cells = 0;
  for (const CutBlock& b : average_.blocks) {
    f.block_loss.push_back((b.count.array() * (b.mean - f.bins[b.level]).array().square()).sum());
    if (b.held_out) continue;
    f.loss += f.block_loss.back();
    cells += static_cast<double>((b.count.array() > 0).count());
  }
  // Errors from all slopes together, of values and coefficients.
  const auto n = static_cast<Eigen::Index>(unknowns.size()), c = trial.coefficients.size();
  const auto rows = static_cast<Eigen::Index>(2 * average_.bins);
  Eigen::MatrixXd slope(trial.residual.size(), n + c);
  for (Eigen::Index i = 0; i < n; ++i) {
    const auto k = static_cast<std::size_t>(i);
    std::vector<double> moved = trial.values;
    const double step =
        moved[k] + unknowns[k].small > unknowns[k].high ? -unknowns[k].small : unknowns[k].small;
    moved[k] += step;
    const bool of_sensor = unknowns[k].kind == offset_x || unknowns[k].kind == offset_y;
    const Trial t = evaluate(unknowns, moved, edges, trial.state, of_sensor ? &trial : nullptr);
    for (std::size_t l = 0; l < average_.levels.size(); ++l)
      slope.col(i).segment(static_cast<Eigen::Index>(l) * rows, rows) =
          ((t.columns[l] - trial.columns[l]) * trial.coefficients + offset_of(t.state) -
           offset_of(trial.state))
              .cwiseProduct(weight_[l].cwiseSqrt()) /
          step;
  }
  for (std::size_t l = 0; l < average_.levels.size(); ++l)
    slope.block(static_cast<Eigen::Index>(l) * rows, n, rows, c) =
        weight_[l].cwiseSqrt().asDiagonal() * trial.columns[l];
  // Columns differ by many powers of ten.
  const Eigen::VectorXd size = slope.colwise().norm().cwiseMax(1e-300);
  const Eigen::MatrixXd scaled = slope * size.cwiseInverse().asDiagonal();
  Eigen::MatrixXd normal = scaled.transpose() * scaled;
  normal.diagonal().array() += 1e-9;
  const Eigen::VectorXd spread = dense::inverse(normal).diagonal().cwiseMax(0.0).cwiseSqrt();
  const double sigma = std::sqrt(f.loss / std::max(1.0, cells));
  // At a bound that the forces do not feel there is no error to speak of.
  for (Eigen::Index i = 0; i < n; ++i) {
    f.value_errors.push_back(size(i) > 1e-200 ? sigma * spread(i) / size(i) : 0);
    f.inflations.push_back(spread(i));
  }
  f.coefficient_errors = sigma * spread.tail(c).cwiseQuotient(size.tail(c));
  return f;
}

/// Turn after which the tool looks the same, as far as the model knows.
double CutFitter::tooth_period() const {
  return teeth_alike(given_.tool) ? kTwoPi / given_.tool.teeth : kTwoPi;
}

void CutFitter::add_nuisances() {
  const MillingTool& tool = given_.tool;
  nuisances_.clear();
  nuisance_values_.clear();
  const auto add = [&](const Unknown& unknown, double value) {
    nuisances_.push_back(unknown);
    nuisance_values_.push_back(value);
  };
  const double slack = criteria_.set_up_slack;
  add({zero, 0, -4 * kPi, 4 * kPi, 1e-3}, 0);
  if (given_.cut.direction != MillingDirection::slot)
    add({immersion, 0, 1 - slack, 1 + slack, 1e-3}, 1);
  if (std::abs(tool.helix_deg) > 0.5) add({lag, 0, 1 - slack, 1 + slack, 1e-3}, 1);
  // What the file says of the throw may be off; that is no missing effect.
  if (!all_alike(tool.throw_m))
    for (const Unknown::Kind kind : {throw_x, throw_y}) add({kind, 0, -3, 3, 1e-3}, 0);
  if (tool.force.size_effect_exponent != 0)
    add({exponent, 0, -0.2, 0.8, 1e-3}, tool.force.size_effect_exponent);
  if (with_offset_)
    for (const Unknown& u : offset().unknowns) add(u, 0);
}

CutFit CutFitter::calibrate(bool channel_is_tool) {
  add_nuisances();
  // Averages of plain samples: where bins are not cut at steps, they smear them.
  const double smeared_rad = steps_in(given_) ? 0 : bin_rad();
  const double usual = channel_is_tool ? 1 : -1;
  CutState about = given_;
  about.blur_rad = smeared_rad;
  Trial best;
  double best_score = std::numeric_limits<double>::infinity();
  const double period = tooth_period();
  const int points = static_cast<int>(std::lround(64 * period * given_.tool.teeth / kTwoPi));
  for (const double mirrored : {1.0, -1.0}) {
    about.sign_x = usual;
    about.sign_y = usual * mirrored;
    for (int k = 0; k < points; ++k) {
      std::vector<double> values = nuisance_values_;
      values[0] = period * (static_cast<double>(k) / points - 0.5);
      Trial t = evaluate(nuisances_, values, false, about);
      // Force the wrong way round, or a mirrored frame, must be much better to be believed.
      const double score = t.loss * (t.coefficients(0) < 0 ? 4 : 1) * (mirrored < 0 ? 4 : 1);
      if (score < best_score) {
        best_score = score;
        best = std::move(t);
      }
    }
  }
  if (best.coefficients(0) < 0) {
    about = best.state;
    about.sign_x = -about.sign_x;
    about.sign_y = -about.sign_y;
    best = evaluate(nuisances_, best.values, false, about);
  }
  CutFit done = settle(best, smeared_rad);
  done.state.blur_rad -= smeared_rad;
  return done;
}

CutFit CutFitter::calibrate(const CutFit& from) {
  add_nuisances();
  std::vector<double> values = from.values;
  values.resize(nuisances_.size(), 0);  // an offset comes last
  return settle(evaluate(nuisances_, values, false, from.state), 0);
}

CutFit CutFitter::calibrate_other_paths(const CutFit& from) {
  given_.circular_paths = !given_.circular_paths;
  return calibrate(from);
}

CutFit CutFitter::calibrate_with(const Structure& structure, bool regeneration, CutFit from) {
  given_.structure = structure;
  given_.cut.regeneration = from.state.cut.regeneration = regeneration;
  return calibrate(from);
}

CutFit CutFitter::calibrate_deeper(double scale, CutFit from) {
  given_.cut.axial_depth_m *= scale;
  for (std::size_t i = 0; i < from.unknowns.size(); ++i)
    if (from.unknowns[i].kind == lag) from.values[i] = 1;
  return calibrate(from);
}

CutFit CutFitter::calibrate_filtered(CutFit from, double filter_hz) {
  // What the filter delays was taken for an angle: 2 (sin 22.5 + sin 67.5 deg) / w.
  const double delay_s = filter_hz > 0 ? 2.6131 / (kTwoPi * filter_hz) : 0;
  from.values[0] += delay_s * average_.levels.front().speed_rad_s;
  given_.filter_hz = filter_hz;
  return calibrate(from);
}

double CutFitter::sample_rad() const {
  double most = 0;
  for (const CutLevel& level : average_.levels)
    if (level.samples_per_turn > 0) most = std::max(most, kTwoPi / level.samples_per_turn);
  return most;
}

bool CutFitter::steep() const {
  const double lag_rad = given_.cut.axial_depth_m *
                         std::abs(std::tan(rad_from_deg(given_.tool.helix_deg))) /
                         given_.tool.radius_m();
  return lag_rad < 2 * sample_rad();
}

CutFit CutFitter::settle(const Trial& about, double smeared_rad) {
  // A sample may be a value or the mean over its period: whichever fits.
  Trial winner;
  for (const double sample : {kInstant, sample_rad()}) {
    CutState with = about.state;
    with.blur_rad = sample + smeared_rad;
    Trial best = evaluate(nuisances_, about.values, false, with);
    refine(best, nuisances_, false, kUnknown);
    if (best.loss < 0.999 * winner.loss) winner = std::move(best);
  }
  winner.values[0] -= tooth_period() * std::round(winner.values[0] / tooth_period());
  winner = evaluate(nuisances_, winner.values, false, winner.state);
  nuisance_values_ = winner.values;
  return finished(winner, nuisances_, false);
}

CutFitter::Plan CutFitter::plan(const std::vector<const Family*>& families,
                                const std::vector<std::size_t>& indices, const CutFit& from) const {
  Plan p;
  p.unknowns = nuisances_;
  p.about = from.state;
  p.about.cut.regeneration = given_.cut.regeneration;
  std::vector<double> base = nuisance_values_;
  for (std::size_t i = 0; i < base.size(); ++i)
    for (std::size_t k = 0; k < from.unknowns.size(); ++k)
      if (from.unknowns[k].kind == nuisances_[i].kind) base[i] = from.values[k];
  p.zero_rad = base[0];
  bool helix_free = false;
  // Values known from an earlier fit with the same family; starts for the new one.
  p.starts = {base};
  for (std::size_t f = 0; f < families.size(); ++f) {
    const Family& family = *families[f];
    p.edges = p.edges || family.edges;
    p.about.cut.regeneration = p.about.cut.regeneration || family.regeneration;
    std::vector<std::vector<double>> own = family.starts;
    if (own.empty()) own.push_back({});
    for (std::size_t k = 0; k < from.families.size(); ++k)
      if (from.families[k] == indices[f]) own = {from.own[k]};
    std::vector<std::vector<double>> wider;
    for (const auto& start : p.starts)
      for (const auto& more : own) {
        wider.push_back(start);
        wider.back().insert(wider.back().end(), more.begin(), more.end());
      }
    p.starts = std::move(wider);
    for (const Unknown& u : family.unknowns) {
      helix_free = helix_free || u.kind == helix;
      p.unknowns.push_back(u);
    }
  }
  p.first_of_families = nuisances_.size();
  if (!helix_free) return p;
  // The lag is the helix's own now.
  for (std::size_t i = 0; i < p.unknowns.size(); ++i)
    if (p.unknowns[i].kind == lag) {
      p.unknowns.erase(p.unknowns.begin() + static_cast<long>(i));
      for (auto& start : p.starts) start.erase(start.begin() + static_cast<long>(i));
      --p.first_of_families;
      break;
    }
  return p;
}

/// The starts that leave least, best first.
std::vector<CutFitter::Trial> CutFitter::best_starts(const Plan& p, std::size_t most) const {
  std::vector<Trial> trials;
  for (const auto& start : p.starts)
    trials.push_back(evaluate(p.unknowns, start, p.edges, p.about));
  std::stable_sort(trials.begin(), trials.end(),
                   [](const Trial& a, const Trial& b) { return a.loss < b.loss; });
  if (trials.size() > most) trials.resize(most);
  return trials;
}

CutFit CutFitter::fitted(const Trial& best, const Plan& p,
                         const std::vector<const Family*>& families,
                         const std::vector<std::size_t>& indices) const {
  CutFit done = finished(best, p.unknowns, p.edges);
  done.families = indices;
  std::size_t at = p.first_of_families;
  for (const Family* family : families) {
    const std::size_t size = family->unknowns.size();
    done.first.push_back(at);
    done.own.emplace_back(done.values.begin() + static_cast<long>(at),
                          done.values.begin() + static_cast<long>(at + size));
    at += size;
  }
  return done;
}

CutFit CutFitter::fit(const std::vector<const Family*>& families,
                      const std::vector<std::size_t>& indices, const CutFit& from) const {
  const Plan p = plan(families, indices, from);
  constexpr std::size_t kRefined = 3;
  std::vector<Trial> trials = best_starts(p, kRefined);
  Trial best;
  for (Trial& t : trials) {
    if (trials.size() > 1) descend(t, p.unknowns, p.edges, kFirstRounds);
    if (t.loss < best.loss) best = std::move(t);
  }
  refine(best, p.unknowns, p.edges, p.zero_rad);
  return fitted(best, p, families, indices);
}

CutFit CutFitter::fit_coarsely(const std::vector<const Family*>& families,
                               const std::vector<std::size_t>& indices, const CutFit& from) const {
  const Plan p = plan(families, indices, from);
  Trial best = best_starts(p, 1)[0];
  descend(best, p.unknowns, p.edges, kFirstRounds);
  return fitted(best, p, families, indices);
}

CutFit CutFitter::fit_again(const std::vector<const Family*>& families,
                            const std::vector<std::size_t>& indices, CutFit from) const {
  from.state.blur_rad = kInstant;
  CutFit values = fit(families, indices, from);
  from.state.blur_rad = sample_rad();
  CutFit means = fit(families, indices, from);
  return values.loss < means.loss ? values : means;
}

}  // namespace servosense::reconcile
