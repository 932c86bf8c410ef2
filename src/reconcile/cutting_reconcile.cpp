#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <numeric>
#include <optional>

#include "cutting_fit.hpp"
#include "servosense/core/units.hpp"
#include "servosense/reconcile/cutting.hpp"
#include "servosense/reconcile/decide.hpp"
#include "servosense/sim/run_parallel.hpp"

namespace servosense::reconcile {
namespace {

/// Less is beyond what averaged revolutions can carry, whatever the statistics say.
constexpr double kLeastGainInNoise = 0.15;
/// Chips on paths, entries and exits are modelled to some thousandths of the force.
constexpr double kLeastGainInEffort = 0.006;
/// What a set of effects must explain of what is beyond the noise.
constexpr double kLeastExplained = 0.7;
/// One effect that explains as much needs no second look.
constexpr double kEnough = 0.93;
/// A second effect must leave less than this share of what the first leaves alone.
constexpr double kPairMustLeave = 0.35;
/// Two candidates are one class when they leave nearly the same: this share of the best's gain.
constexpr double kClassShare = 0.03;
constexpr std::size_t kTop = 6;
constexpr double kLargestModelError = 3;  // a factor; beyond it the file is of another cut
constexpr std::size_t kMapBins = 48;

std::string printed(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.4g", value);
  return text;
}
double root(double square) { return std::sqrt(std::max(0.0, square)); }

class CuttingWorkflow {
 public:
  CuttingWorkflow(const CuttingData& data, const Options& options)
      : data_(data), options_(options) {}
  Expected<CuttingOutcome> run();

 private:
  /// Mean square beyond the noise of what a fit leaves, on the blocks fitted.
  [[nodiscard]] double beyond_noise(const CutFit& fit) const {
    return (fit.loss - average_.noise_N * average_.noise_N * cells_) / samples_;
  }
  [[nodiscard]] double least_gain() const {
    return std::max(kLeastGainInNoise * average_.noise_N, kLeastGainInEffort * average_.effort_N);
  }
  [[nodiscard]] CutFit fit(const std::vector<std::size_t>& set, const CutFit& from) const {
    std::vector<const Family*> chosen;
    for (const std::size_t f : set) chosen.push_back(&families_[f]);
    return fitter_->fit(chosen, set, from);
  }
  [[nodiscard]] CutFit fit_again(const std::vector<std::size_t>& set) const {
    std::vector<const Family*> chosen;
    for (const std::size_t f : set) chosen.push_back(&families_[f]);
    return fitter_->fit_again(chosen, set, found_);
  }
  [[nodiscard]] std::vector<CutFit> fit_all(const std::vector<std::vector<std::size_t>>& sets,
                                            const CutFit& from) const;
  [[nodiscard]] bool compatible(const std::vector<std::size_t>& set, std::size_t more) const;
  [[nodiscard]] std::string objection(const CutFit& fit, std::size_t position) const;
  [[nodiscard]] std::string inconstancy(const CutFit& with, const CutFit& without) const;
  [[nodiscard]] double errors_between(const CutFit& worse, const CutFit& better) const;
  [[nodiscard]] std::vector<NamedValue> parameters(const CutFit& fit, std::size_t position,
                                                   bool errors) const;
  void measure_again(const CutFit& fit);
  void search();
  void name_effects(Report& report);
  void held_out_gap(const CutFit& fit, double& gap, double& rezeroed) const;
  [[nodiscard]] Column predicted(const CutState& state, bool y) const;
  void find_lines(Report& report) const;
  void testability(Report& report) const;
  void maps(Report& report, const CutFit& before, const CutFit& after) const;
  [[nodiscard]] Problem map_problem(const CutFit& fit, Column& residual) const;
  void recalibrated(Report& report) const;

  const CuttingData& data_;
  const Options& options_;
  CutAverage average_;
  std::optional<CutFitter> fitter_;
  CutState given_;
  std::vector<Family> families_;
  double cells_ = 0, samples_ = 0;
  CutFit base_, found_;
  std::vector<RankedCandidate> ranking_;
  std::string why_nothing_;
};

bool CuttingWorkflow::compatible(const std::vector<std::size_t>& set, std::size_t more) const {
  for (const std::size_t f : set) {
    if (f == more) return false;
    if (!families_[f].twin.empty() && families_[f].twin == families_[more].twin &&
        families_[f].tooth == families_[more].tooth)
      return false;
    // Two ways for one mode: not both.
    if (families_[f].info == families_[more].info && families_[f].twin == "extra-mode")
      return false;
  }
  return true;
}

std::vector<CutFit> CuttingWorkflow::fit_all(const std::vector<std::vector<std::size_t>>& sets,
                                             const CutFit& from) const {
  std::vector<CutFit> fits(sets.size());
  run_parallel(sets.size(), [&](std::size_t i) { fits[i] = fit(sets[i], from); }, options_.threads);
  return fits;
}

/// Difference of two losses in its standard errors, block by block.
double CuttingWorkflow::errors_between(const CutFit& worse, const CutFit& better) const {
  double sum = 0, square = 0, n = 0;
  for (std::size_t b = 0; b < average_.blocks.size(); ++b) {
    if (average_.blocks[b].held_out) continue;
    const double d = worse.block_loss[b] - better.block_loss[b];
    sum += d;
    square += d * d;
    ++n;
  }
  const double variance = (square - sum * sum / n) * n / std::max(1.0, n - 1);
  return sum / std::sqrt(std::max(1e-300, variance));
}

/// The rule of physics that an effect of a fit breaks; empty when it keeps them all.
std::string CuttingWorkflow::objection(const CutFit& fit, std::size_t position) const {
  const Family& family = families_[fit.families[position]];
  const auto value = [&](std::size_t k) { return fit.own[position][k]; };
  if (family.edges) {
    const double kte = fit.state.coefficients[2], kre = fit.state.coefficients[3];
    if (kte < -3 * fit.coefficient_errors(2) || kre < -3 * fit.coefficient_errors(3)) {
      // Small beside the other is no contradiction: one of them may be absent.
      if (kte < -0.15 * std::abs(kre) || kre < -0.15 * std::abs(kte))
        return "shape fits, physics does not: an edge force that pulls";
    }
  }
  if (family.info == &SizeEffect::info && !(value(0) > 0))
    return "shape fits, physics does not: force that grows faster than the chip";
  if (!family.unknowns.empty()) {
    switch (family.unknowns[0].kind) {
      case Unknown::Kind::shorter:
        if (!(value(0) > 0)) return "shape fits, physics does not: a tooth that has grown";
        break;
      case Unknown::Kind::broken:
        if (!(value(0) > 0)) return "nothing is broken";
        break;
      case Unknown::Kind::throw_x:
        if (std::hypot(value(0), value(family.unknowns.size() - 1)) > 2.9)
          return "shape fits, physics does not: a throw of several feeds";
        break;
      case Unknown::Kind::helix:
        if (value(0) >= 69.9 || value(0) <= -4.9)
          return "shape fits, physics does not: no such helix";
        break;
      case Unknown::Kind::sensor_hz:
        if (value(1) >= std::log(0.89) || value(3) >= std::log(0.89))
          return "shape fits, physics does not: damping of 0.9";
        break;
      case Unknown::Kind::mode_hz:
        if (value(1) >= std::log(0.69)) return "shape fits, physics does not: damping of 0.7";
        break;
      default:
        break;
    }
  }
  if (!(fit.state.coefficients[0] > 0)) return "shape fits, physics does not: force pulls the chip";
  return {};
}

/// A cause has one size all along the record; a proxy grows or fades with it.
std::string CuttingWorkflow::inconstancy(const CutFit& with, const CutFit& without) const {
  // Size of the effect in each block, 1 on the whole, and its trend over time.
  std::vector<double> t, a, w;
  for (const CutBlock& b : average_.blocks) {
    if (b.held_out) continue;
    const Eigen::ArrayXd d = (with.bins[b.level] - without.bins[b.level]).array();
    const double power = (b.count.array() * d * d).sum();
    if (!(power > 0)) continue;
    const double more = (b.count.array() * d * (b.mean - with.bins[b.level]).array()).sum() / power;
    t.push_back(b.time_s);
    a.push_back(1 + more);
    w.push_back(power);
  }
  if (t.size() < 6) return {};
  double sw = 0, st = 0, sa = 0;
  for (std::size_t i = 0; i < t.size(); ++i) {
    sw += w[i];
    st += w[i] * t[i];
    sa += w[i] * a[i];
  }
  double stt = 0, sta = 0;
  for (std::size_t i = 0; i < t.size(); ++i) {
    stt += w[i] * (t[i] - st / sw) * (t[i] - st / sw);
    sta += w[i] * (t[i] - st / sw) * (a[i] - sa / sw);
  }
  if (!(stt > 0)) return {};
  const double slope = sta / stt;
  double rest = 0;
  for (std::size_t i = 0; i < t.size(); ++i) {
    const double r = a[i] - sa / sw - slope * (t[i] - st / sw);
    rest += w[i] * r * r;
  }
  const double error = std::sqrt(rest / (static_cast<double>(t.size()) - 2) / stt);
  const double change = slope * (t.back() - t.front());
  if (std::abs(change) > options_.largest_inconstancy && std::abs(slope) > 4 * error)
    return "its size changes along the record";
  return {};
}

Column CuttingWorkflow::predicted(const CutState& state, bool y) const {
  // From a fine curve of each level: samples are many.
  constexpr std::size_t kPoints = 1440;
  std::vector<double> angles;
  for (std::size_t i = 0; i < kPoints; ++i)
    angles.push_back(kTwoPi * static_cast<double>(i) / kPoints);
  const Eigen::Map<const Eigen::Vector4d> c(state.coefficients.data());
  std::vector<Eigen::VectorXd> curves;
  for (const CutLevel& level : average_.levels)
    curves.push_back(force_columns(state, level.feed_per_tooth_m, level.speed_rad_s, angles) *
                     c.head(state.columns()));
  Column out(data_.time_s.size(), 0);
  for (std::size_t i = 0; i < out.size(); ++i) {
    if (average_.block_of[i] == CutAverage::kNone) continue;
    const Eigen::VectorXd& curve = curves[average_.blocks[average_.block_of[i]].level];
    double g = data_.angle_rad[i] / kTwoPi;
    g = (g - std::floor(g)) * kPoints;
    const auto k = std::min(static_cast<std::size_t>(g), kPoints - 1);
    const double part = g - static_cast<double>(k);
    const auto at = [&](std::size_t j) {
      return curve(static_cast<Eigen::Index>((y ? kPoints : 0) + j % kPoints));
    };
    out[i] = at(k) + part * (at(k + 1) - at(k));
  }
  return out;
}

void CuttingWorkflow::measure_again(const CutFit& fit) {
  average_again(
      average_, data_,
      {predicted(fit.state, false), predicted(fit.state, true), fitter_->forces(fit.state)});
  cells_ = samples_ = 0;
  for (const CutBlock& b : average_.blocks) {
    if (b.held_out) continue;
    cells_ += static_cast<double>((b.count.array() > 0).count());
    samples_ += b.count.sum();
  }
}

void CuttingWorkflow::search() {
  found_ = base_;
  std::vector<std::size_t> set;
  while (set.size() < options_.most_effects) {
    const double now = beyond_noise(found_);
    if (root(now) < least_gain()) break;
    std::vector<std::vector<std::size_t>> sets;
    for (std::size_t f = 0; f < families_.size(); ++f)
      if (compatible(set, f)) {
        sets.push_back(set);
        sets.back().push_back(f);
      }
    std::vector<CutFit> fits = fit_all(sets, found_);
    std::vector<std::size_t> order(fits.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::stable_sort(order.begin(), order.end(),
                     [&](std::size_t a, std::size_t b) { return fits[a].loss < fits[b].loss; });
    std::vector<std::string> objections(fits.size());
    ranking_.clear();
    for (const std::size_t i : order) {
      objections[i] = objection(fits[i], set.size());
      ranking_.push_back(
          {families_[sets[i].back()].info->name, root(beyond_noise(fits[i])),
           std::clamp((now - beyond_noise(fits[i])) / std::max(1e-300, now), 0.0, 1.0),
           objections[i]});
    }
    std::size_t best = order.size();
    for (const std::size_t i : order)
      if (objections[i].empty()) {
        best = i;
        break;
      }
    if (best == order.size() || root(now - beyond_noise(fits[best])) < least_gain()) {
      why_nothing_ = "no candidate explains more than the noise allows";
      break;
    }
    const CutFit& front = fits[order[0]];
    if (order[0] != best && root(beyond_noise(fits[best]) - beyond_noise(front)) > least_gain() &&
        beyond_noise(front) < 0.5 * beyond_noise(fits[best])) {
      why_nothing_ =
          std::string(families_[sets[order[0]].back()].info->name) + ": " + objections[order[0]];
      break;
    }
    const double rest = beyond_noise(fits[best]);
    const double explained = (now - rest) / now;
    if (explained < kEnough && root(rest) > least_gain()) {
      // One does not carry the gap: perhaps two do.
      std::vector<std::vector<std::size_t>> pairs;
      std::vector<std::size_t> top;
      for (const std::size_t i : order) {
        const bool same_name = std::any_of(top.begin(), top.end(), [&](std::size_t t) {
          return families_[sets[t].back()].info == families_[sets[i].back()].info;
        });
        if (!same_name) top.push_back(i);
        if (top.size() == kTop) break;
      }
      for (std::size_t a = 0; a < top.size(); ++a)
        for (std::size_t b = a + 1; b < top.size(); ++b)
          if (compatible({sets[top[a]].back()}, sets[top[b]].back())) {
            pairs.push_back(sets[top[a]]);
            pairs.back().push_back(sets[top[b]].back());
          }
      std::vector<CutFit> pair_fits;
      for (std::size_t p = 0; p < pairs.size(); ++p) {
        // From the better of the two alone.
        const auto first = static_cast<std::size_t>(
            std::find_if(top.begin(), top.end(),
                         [&](std::size_t t) { return sets[t].back() == pairs[p][set.size()]; }) -
            top.begin());
        pair_fits.push_back(fits[top[first]]);
      }
      std::vector<CutFit> done(pairs.size());
      run_parallel(
          pairs.size(), [&](std::size_t p) { done[p] = fit(pairs[p], pair_fits[p]); },
          options_.threads);
      std::size_t winner = done.size();
      for (std::size_t p = 0; p < done.size(); ++p) {
        if (!objection(done[p], set.size()).empty() || !objection(done[p], set.size() + 1).empty())
          continue;
        if (winner == done.size() || done[p].loss < done[winner].loss) winner = p;
      }
      if (winner < done.size() && beyond_noise(done[winner]) < kPairMustLeave * rest &&
          root(rest - beyond_noise(done[winner])) > least_gain() &&
          (now - beyond_noise(done[winner])) / now > kLeastExplained) {
        set = pairs[winner];
        found_ = done[winner];
        measure_again(found_);
        found_ = fit_again(set);
        measure_again(found_);
        continue;
      }
    }
    if (explained < kLeastExplained) {
      why_nothing_ = "the best candidate, " + std::string(families_[sets[best].back()].info->name) +
                     ", explains only " + std::to_string(static_cast<int>(100 * explained)) +
                     " % of what is beyond the noise";
      break;
    }
    set = sets[best];
    found_ = fits[best];
    measure_again(found_);
    found_ = fit_again(set);
    measure_again(found_);
  }
  // Backwards: what later additions made needless.
  for (std::size_t i = 0; i < set.size() && set.size() > 1;) {
    std::vector<std::size_t> fewer = set;
    fewer.erase(fewer.begin() + static_cast<long>(i));
    CutFit without = fit(fewer, base_);
    if (root(beyond_noise(without) - beyond_noise(found_)) < least_gain()) {
      set = fewer;
      found_ = std::move(without);
    } else {
      ++i;
    }
  }
}

std::vector<NamedValue> CuttingWorkflow::parameters(const CutFit& fit, std::size_t position,
                                                    bool errors) const {
  const Family& family = families_[fit.families[position]];
  const auto value = [&](std::size_t k) { return fit.own[position][k]; };
  const auto spread = [&](std::size_t k) { return fit.value_errors[fit.first[position] + k]; };
  const auto pick = [&](std::size_t k) { return errors ? spread(k) : value(k); };
  const double feed = data_.cut.feed_per_tooth_m;
  std::vector<NamedValue> out;
  if (family.edges) {
    for (std::size_t k = 0; k < 2; ++k) {
      const double size = std::max(0.0, fit.state.coefficients[2 + k]);
      const double error = fit.coefficient_errors(static_cast<Eigen::Index>(2 + k));
      out.push_back({family.info->parameters[k].key, {errors ? error : size}});
    }
    return out;
  }
  switch (family.unknowns[0].kind) {
    case Unknown::Kind::throw_x: {
      const double x = value(0), y = family.unknowns.size() > 1 ? value(1) : 0;
      const double size = std::hypot(x, y);
      if (!errors) {
        out.push_back({"throw_m", {size * feed}});
        out.push_back({"angle_rad", {std::atan2(y, x)}});
      } else {
        const double e = family.unknowns.size() > 1
                             ? root(0.5 * (spread(0) * spread(0) + spread(1) * spread(1)))
                             : spread(0);
        out.push_back({"throw_m", {e * feed}});
        out.push_back({"angle_rad", {size > 0 ? e / size : kPi}});
      }
      break;
    }
    case Unknown::Kind::broken:
      out.push_back({"tooth", {errors ? 0 : static_cast<double>(family.tooth + 1)}});
      out.push_back({"fraction", {pick(0)}});
      break;
    case Unknown::Kind::shorter:
      out.push_back({"tooth", {errors ? 0 : static_cast<double>(family.tooth + 1)}});
      out.push_back({"fraction", {errors ? spread(0) : std::min(1.0, value(0))}});
      out.push_back({"shorter_m", {pick(0) * feed}});
      break;
    case Unknown::Kind::pitch: {
      NamedValue v{"angle_rad", {0}};
      for (std::size_t k = 0; k < family.unknowns.size(); ++k) v.values.push_back(pick(k));
      out.push_back(std::move(v));
      break;
    }
    case Unknown::Kind::sensor_hz: {
      constexpr std::array kKeys = {"natural_frequency_hz", "damping_ratio",
                                    "natural_frequency_y_hz", "damping_ratio_y"};
      for (std::size_t k = 0; k < kKeys.size(); ++k)
        out.push_back({kKeys[k], {errors ? spread(k) * std::exp(value(k)) : std::exp(value(k))}});
      break;
    }
    case Unknown::Kind::mode_hz:
      for (std::size_t k = 0; k < family.unknowns.size(); ++k)
        out.push_back({family.info->parameters[k].key,
                       {errors ? spread(k) * std::exp(value(k)) : std::exp(value(k))}});
      break;
    default:
      out.push_back({family.info->parameters[0].key, {pick(0)}});
  }
  return out;
}

/// Each effect beside the others: its class, its constancy, its runner-up.
void CuttingWorkflow::name_effects(Report& report) {
  for (bool changed = true; changed;) {
    changed = false;
    report.effects.clear();
    std::vector<std::size_t> set = found_.families;
    for (std::size_t i = 0; i < set.size() && !changed; ++i) {
      std::vector<std::size_t> fewer = set;
      fewer.erase(fewer.begin() + static_cast<long>(i));
      const CutFit without = fewer.empty() ? base_ : fit(fewer, base_);
      std::vector<std::vector<std::size_t>> sets;
      for (std::size_t f = 0; f < families_.size(); ++f)
        if (f != set[i] && compatible(fewer, f)) {
          sets.push_back(fewer);
          sets.back().push_back(f);
        }
      const std::vector<CutFit> others = fit_all(sets, without);
      const double rest = beyond_noise(found_);
      const double gain = beyond_noise(without) - rest;
      FoundEffect effect;
      const CuttingEffectInfo& info = *families_[set[i]].info;
      effect.name = info.name;
      effect.scope = info.scope;
      effect.where = info.where;
      effect.share_of_residual =
          std::clamp(gain / std::max(1e-300, beyond_noise(without)), 0.0, 1.0);
      effect.ranking.push_back({info.name, root(rest), effect.share_of_residual, ""});
      double margin = 8, runner = std::numeric_limits<double>::infinity();
      for (std::size_t k = 0; k < others.size(); ++k) {
        const Family& other = families_[sets[k].back()];
        if (other.info == &info) continue;
        const std::string why = objection(others[k], fewer.size());
        const double its = beyond_noise(others[k]);
        effect.ranking.push_back(
            {other.info->name, root(its),
             std::clamp((beyond_noise(without) - its) / std::max(1e-300, beyond_noise(without)),
                        0.0, 1.0),
             why});
        if (!why.empty()) continue;
        const double more = its - rest;
        const bool alike = more < kClassShare * gain ||
                           errors_between(others[k], found_) < options_.class_standard_errors ||
                           root(more) < 0.5 * least_gain();
        if (alike && beyond_noise(without) - its > 0.7 * gain) {
          if (std::find(effect.class_members.begin(), effect.class_members.end(),
                        other.info->name) == effect.class_members.end())
            effect.class_members.emplace_back(other.info->name);
        } else if (its < runner) {
          runner = its;
          effect.runner_up = other.info->name;
          effect.runner_up_gap = std::hypot(root(its), average_.noise_N);
          margin = errors_between(others[k], found_);
        }
      }
      std::stable_sort(effect.ranking.begin(), effect.ranking.end(),
                       [](const RankedCandidate& a, const RankedCandidate& b) {
                         return a.gap_after < b.gap_after;
                       });
      if (!effect.class_members.empty()) effect.splitting_motion = info.splitting_experiment;
      std::string why = inconstancy(found_, without);
      if (why.empty() && effect.class_members.size() > 2)
        why = "this cut cannot tell it from " + std::to_string(effect.class_members.size()) +
              " other effects";
      if (!why.empty()) {
        why_nothing_ = effect.name + ": " + why;
        ranking_ = effect.ranking;
        found_ = without;
        changed = true;
        break;
      }
      const double clear = 0.5 * std::erfc(-0.5 * margin);
      const double explained = 1 - std::max(0.0, rest) / std::max(1e-300, beyond_noise(base_));
      effect.confidence = std::clamp(clear * std::min(1.0, explained + 0.05), 0.0, 0.99);
      effect.parameters = parameters(found_, i, false);
      effect.standard_errors = parameters(found_, i, true);
      report.effects.push_back(std::move(effect));
    }
    if (changed && !found_.families.empty()) {
      // What is left must still carry the gap.
      if (1 - beyond_noise(found_) / beyond_noise(base_) < kLeastExplained) found_ = base_;
    }
  }
}

/// rms of measurement less model over the samples kept for the proof, before and after finding the
/// angular zero anew from their first tenth (an encoder without an index forgets it).
void CuttingWorkflow::held_out_gap(const CutFit& fit, double& gap, double& rezeroed) const {
  const auto gap_of = [&](const CutState& state) {
    const Column x = predicted(state, false), y = predicted(state, true);
    double square = 0, n = 0;
    for (std::size_t i = 0; i < x.size(); ++i) {
      if (average_.block_of[i] == CutAverage::kNone ||
          !average_.blocks[average_.block_of[i]].held_out)
        continue;
      const double dx = data_.force_x_N[i] - x[i], dy = data_.force_y_N[i] - y[i];
      square += 0.5 * (dx * dx + dy * dy);
      ++n;
    }
    return n > 0 ? std::sqrt(square / n) : 0;
  };
  gap = gap_of(fit.state);
  rezeroed = gap;
  std::vector<const CutBlock*> first;
  for (const CutBlock& b : average_.blocks)
    if (b.held_out) first.push_back(&b);
  if (first.empty()) return;
  first.resize(std::max<std::size_t>(1, first.size() / 10));
  double best = std::numeric_limits<double>::infinity();
  CutState moved = fit.state;
  const auto loss = [&](double zero) {
    CutState s = fit.state;
    s.zero_rad = zero;
    const std::vector<Eigen::VectorXd> forces = fitter_->forces(s);
    double sum = 0;
    for (const CutBlock* b : first)
      sum += (b->count.array() * (b->mean - forces[b->level]).array().square()).sum();
    return sum;
  };
  constexpr int kPoints = 180;
  for (int k = 0; k < kPoints; ++k) {
    const double zero = fit.state.zero_rad + kTwoPi * k / kPoints;
    const double l = loss(zero);
    if (l < best) {
      best = l;
      moved.zero_rad = zero;
    }
  }
  double low = moved.zero_rad - kTwoPi / kPoints, high = moved.zero_rad + kTwoPi / kPoints;
  for (int k = 0; k < 24; ++k) {
    const double left = low + (high - low) / 3, right = high - (high - low) / 3;
    (loss(left) < loss(right) ? high : low) = loss(left) < loss(right) ? right : left;
  }
  moved.zero_rad = 0.5 * (low + high);
  rezeroed = gap_of(moved);
}

/// Lines fixed in time: what the average over revolutions has removed.
void CuttingWorkflow::find_lines(Report& report) const {
  const Column x = predicted(found_.state, false), y = predicted(found_.state, true);
  // The longest stretch of steady cutting without a gap.
  std::size_t from = 0, length = 0;
  for (std::size_t i = 0; i < x.size();) {
    std::size_t end = i;
    while (end < x.size() && average_.block_of[end] != CutAverage::kNone) ++end;
    if (end - i > length) {
      from = i;
      length = end - i;
    }
    i = end + 1;
  }
  std::size_t n = 1;
  while (2 * n <= std::min<std::size_t>(length, 65536)) n *= 2;
  if (n < 512) return;
  const double rate_hz =
      static_cast<double>(n - 1) / (data_.time_s[from + n - 1] - data_.time_s[from]);
  const double turn_hz =
      average_.levels[average_.blocks[average_.block_of[from]].level].speed_rad_s / kTwoPi;
  for (int axis = 0; axis < 2; ++axis) {
    std::vector<std::complex<double>> z(n);
    double square = 0;
    for (std::size_t i = 0; i < n; ++i) {
      const std::size_t at = from + i;
      const CutBlock& block = average_.blocks[average_.block_of[at]];
      const Eigen::Index bin = average_.bin_of(data_.angle_rad[at]) +
                               (axis == 1 ? static_cast<Eigen::Index>(average_.bins) : 0);
      const double model = axis == 0 ? x[at] : y[at];
      const double locked = block.mean(bin) - found_.bins[block.level](bin);
      const double r = (axis == 0 ? data_.force_x_N[at] : data_.force_y_N[at]) - model -
                       (block.count(bin) > 3 ? locked : 0);
      square += r * r;
      const double window =
          1 - std::cos(kTwoPi * (static_cast<double>(i) + 0.5) / static_cast<double>(n));
      z[i] = r * window;
    }
    square /= static_cast<double>(n);
    // Radix two, in place (Cooley and Tukey 1965).
    for (std::size_t i = 1, j = 0; i < n; ++i) {
      std::size_t bit = n >> 1U;
      for (; j & bit; bit >>= 1U) j ^= bit;
      j ^= bit;
      if (i < j) std::swap(z[i], z[j]);
    }
    for (std::size_t len = 2; len <= n; len *= 2) {
      const std::complex<double> w = std::polar(1.0, -kTwoPi / static_cast<double>(len));
      for (std::size_t i = 0; i < n; i += len) {
        std::complex<double> t = 1;
        for (std::size_t k = 0; k < len / 2; ++k, t *= w) {
          const auto u = z[i + k], v = z[i + k + len / 2] * t;
          z[i + k] = u + v;
          z[i + k + len / 2] = u - v;
        }
      }
    }
    std::size_t peak = 2;
    for (std::size_t k = 2; k < n / 2; ++k)
      if (std::norm(z[k]) > std::norm(z[peak])) peak = k;
    // A line of amplitude A has |z| = A n / 2 with this window, and its neighbours half of it.
    double power = 0;
    for (std::size_t k = peak - 1; k <= peak + 1; ++k) power += std::norm(z[k]);
    const double amplitude = std::sqrt(power / 1.5) * 2 / static_cast<double>(n);
    const double hz = static_cast<double>(peak) * rate_hz / static_cast<double>(n);
    const double order = hz / turn_hz;
    if (0.5 * amplitude * amplitude > options_.least_line_share * square &&
        std::abs(order - std::round(order)) * turn_hz > 2 * rate_hz / static_cast<double>(n)) {
      const bool known =
          std::any_of(report.lines.begin(), report.lines.end(), [&](const TimeLine& l) {
            return std::abs(l.frequency_hz - hz) < 2 * rate_hz / static_cast<double>(n);
          });
      if (!known) report.lines.push_back({hz, amplitude});
    }
  }
}

/// What these cuts could not have shown.
void CuttingWorkflow::testability(Report& report) const {
  const MillingTool& tool = data_.tool;
  double samples = std::numeric_limits<double>::infinity();
  for (const CutLevel& level : average_.levels)
    if (level.samples_per_turn > 0) samples = std::min(samples, level.samples_per_turn);
  const auto cannot = [&](const CuttingEffectInfo& info, const char* because) {
    report.not_testable.push_back({info.name, because, info.splitting_experiment});
  };
  for (const CuttingEffectInfo& info : kCuttingEffects) {
    const std::string_view name = info.name;
    if (name == "regeneration" || name == "process-damping")
      cannot(info, "the displacement of the tool is not in the trace");
    else if (tool.teeth == 1 &&
             (name == "runout" || name == "missing-tooth" || name == "pitch-error"))
      cannot(info, "the tool has one tooth");
    else if (samples < 10 && (name == "sensor-resonance" || name == "extra-mode"))
      cannot(info, "too few samples in a revolution");
  }
}

Problem CuttingWorkflow::map_problem(const CutFit& fit, Column& residual) const {
  Problem p;
  p.unit = "N";
  const auto bins = static_cast<Eigen::Index>(average_.bins);
  // Thinned out to some 48 bins a direction, so that maps compare means, not samples.
  Coordinate tooth{"tooth-angle", "rad", {}, {}, 2 * kTwoPi, kMapBins};
  Coordinate turn{"tooth", "rad", {}, {}, 2 * kTwoPi, kMapBins};
  Coordinate chip{"chip-thickness", "m", {}, {}, 0, 24};
  Coordinate feed{"feed", "m", {}, {}, 0, 12};
  Coordinate time{"time", "s", {}, {}, 0, 24};
  for (const CutBlock& b : average_.blocks) {
    const CutLevel& level = average_.levels[b.level];
    for (Eigen::Index r = 0; r < 2 * bins; ++r) {
      if (!(b.count(r) > 0)) continue;
      const double angle = level.angle_rad[static_cast<std::size_t>(r % bins)];
      const double direction = r < bins ? 0 : kTwoPi;
      p.time_s.push_back(b.time_s);
      p.target.push_back(b.mean(r));
      p.usable.push_back(true);
      p.held_out.push_back(b.held_out);
      residual.push_back(b.mean(r) - fit.bins[b.level](r));
      const double pitches = (angle + fit.state.zero_rad) * data_.tool.teeth;
      tooth.values.push_back(pitches - kTwoPi * std::floor(pitches / kTwoPi) + direction);
      turn.values.push_back(angle + direction);
      chip.values.push_back(chip_thickness_m(fit.state, level.feed_per_tooth_m, angle) *
                            (r < bins ? 1 : -1));
      feed.values.push_back(level.feed_per_tooth_m);
      time.values.push_back(b.time_s);
    }
  }
  p.coordinates = {std::move(tooth), std::move(turn), std::move(chip), std::move(feed),
                   std::move(time)};
  return p;
}

void CuttingWorkflow::maps(Report& report, const CutFit& before, const CutFit& after) const {
  Column residual;
  const Problem first = map_problem(before, residual);
  report.maps_before = maps_of(first, residual, options_);
  residual.clear();
  const Problem last = map_problem(after, residual);
  report.maps_after = maps_of(last, residual, options_);
}

void CuttingWorkflow::recalibrated(Report& report) const {
  const CutState& s = found_.state;
  const CuttingForceLaw& law = data_.tool.force;
  const double kt = s.coefficients[0], kr = s.coefficients[1];
  report.recalibrated.push_back({"tangential_coefficient_N_per_m2",
                                 law.tangential_coefficient_N_per_m2, kt,
                                 found_.coefficient_errors(0)});
  report.recalibrated.push_back(
      {"radial_ratio", law.radial_ratio, kr / kt,
       std::hypot(found_.coefficient_errors(1), kr / kt * found_.coefficient_errors(0)) /
           std::abs(kt)});
  if (given_.edges) {
    report.recalibrated.push_back({"tangential_edge_N_per_m", law.tangential_edge_N_per_m,
                                   s.coefficients[2], found_.coefficient_errors(2)});
    report.recalibrated.push_back({"radial_edge_N_per_m", law.radial_edge_N_per_m,
                                   s.coefficients[3], found_.coefficient_errors(3)});
  }
  for (std::size_t i = 0; i < found_.unknowns.size(); ++i) {
    const double v = found_.values[i], e = found_.value_errors[i];
    if (found_.unknowns[i].kind == Unknown::Kind::immersion)
      report.recalibrated.push_back({"radial_immersion_m", data_.cut.radial_immersion_m,
                                     data_.cut.radial_immersion_m * v,
                                     data_.cut.radial_immersion_m * e});
    if (found_.unknowns[i].kind == Unknown::Kind::lag)
      report.recalibrated.push_back({"axial_depth_m", data_.cut.axial_depth_m,
                                     data_.cut.axial_depth_m * v, data_.cut.axial_depth_m * e});
  }
}

Expected<CuttingOutcome> CuttingWorkflow::run() {
  auto averaged = average(data_, options_);
  if (!averaged) return averaged.error();
  average_ = std::move(*averaged);
  given_.tool = data_.tool;
  given_.cut = data_.cut;
  given_.structure = data_.structure;
  given_.edges =
      data_.tool.force.tangential_edge_N_per_m != 0 || data_.tool.force.radial_edge_N_per_m != 0;
  const double nominal_kt = data_.tool.force.tangential_coefficient_N_per_m2;
  given_.coefficients = {nominal_kt, nominal_kt * data_.tool.force.radial_ratio,
                         data_.tool.force.tangential_edge_N_per_m,
                         data_.tool.force.radial_edge_N_per_m};
  const bool on_tool = data_.channel == "tool";
  const double feed = data_.cut.feed_per_tooth_m;
  // Again with samples averaged about the first model, so that bins do not smear them.
  for (int round = 0; round < 3; ++round) {
    fitter_.emplace(average_, given_, feed);
    base_ = round == 0 ? fitter_->calibrate(on_tool) : fitter_->calibrate(base_);
    measure_again(base_);
  }

  const double ratio = base_.state.coefficients[0] / nominal_kt;
  if (!(ratio < kLargestModelError && ratio > 1 / kLargestModelError))
    return data_error("the trace asks for tangential_coefficient_N_per_m2 = " +
                      printed(base_.state.coefficients[0]) + ", the machine file says " +
                      printed(nominal_kt) +
                      "; check it, the feed, the depth and the calibration of the sensor");

  // The scan for resonances is dear: not where nothing is missing.
  if (root(beyond_noise(base_)) >= least_gain()) families_ = fitter_->families(base_);
  CuttingOutcome outcome;
  Report& report = outcome.report;
  report.channel = data_.channel;
  report.gap_unit = "N";
  report.remarks = data_.remarks;
  search();
  name_effects(report);
  report.floors.lap = report.floors.used = average_.noise_N;

  // The proof.
  double before = 0, after = 0, before_moved = 0, after_moved = 0;
  held_out_gap(base_, before, before_moved);
  held_out_gap(found_, after, after_moved);
  const bool moved = after_moved < 0.8 * after && after > 1.2 * average_.noise_N;
  if (moved)
    report.remarks.emplace_back(
        "the angular zero has changed for the end of the record; it was found again from its first "
        "tenth");
  report.gap_before = moved ? before_moved : before;
  report.gap_after = moved ? after_moved : after;
  CutState nominal = base_.state;
  nominal.immersion_scale = nominal.lag_scale = 1;
  nominal.coefficients = given_.coefficients;
  CutFit as_given = base_;
  as_given.state = nominal;
  double ignored = 0;
  held_out_gap(as_given, report.gap_nominal, ignored);
  report.held_from_s = average_.held_from_s;
  report.held_to_s = average_.held_to_s;
  double gap = report.gap_before;
  for (std::size_t i = 0; i < report.effects.size(); ++i) {
    report.effects[i].gap_before = gap;
    if (i + 1 == report.effects.size()) {
      gap = report.gap_after;
    } else {
      const std::vector<std::size_t> part(found_.families.begin(),
                                          found_.families.begin() + static_cast<long>(i + 1));
      double own = 0, own_moved = 0;
      held_out_gap(fit(part, base_), own, own_moved);
      gap = moved ? own_moved : own;
    }
    report.effects[i].gap_after = gap;
  }
  if (!report.effects.empty() && report.gap_after >= report.gap_before) {
    // It does not hold where it was not fitted.
    why_nothing_ = report.effects[0].name + ": does not shrink the gap on the end of the record";
    report.effects.clear();
    found_ = base_;
    report.gap_after = report.gap_before;
  }

  const double left = root(beyond_noise(found_));
  const double held_left =
      root(report.gap_after * report.gap_after - average_.noise_N * average_.noise_N);
  const bool at_floor =
      left < least_gain() && held_left < std::max(1.1 * average_.noise_N, 3 * least_gain());
  using enum servosense::reconcile::Verdict;
  report.verdict = report.effects.empty() ? (at_floor ? agrees : unexplained)
                                          : (at_floor ? explained : partly_explained);
  report.ranking = ranking_;
  report.residual_white = at_floor;
  report.residual_detail = at_floor ? "" : why_nothing_;
  recalibrated(report);
  find_lines(report);
  testability(report);
  maps(report, base_, found_);
  for (FoundEffect& e : report.effects)
    for (const ResidualMap& map : report.maps_before)
      if (map.variable == e.where) e.share_of_residual = map.share;
  report.time_s = data_.time_s;
  report.measured = data_.force_x_N;
  report.simulated_before = predicted(base_.state, false);
  report.simulated_after = predicted(found_.state, false);
  report.summary = summary_of(report, "cut");
  return outcome;
}

}  // namespace

Expected<CuttingOutcome> reconcile_cutting(const CuttingData& data, const Options& options) {
  return CuttingWorkflow(data, options).run();
}

void augment(MachineFile& machine, const CuttingOutcome& outcome, const std::string& provenance) {
  const Report& r = outcome.report;
  const auto rounded = [](double v) {
    char text[40];
    std::snprintf(text, sizeof text, "%.8g", v);
    return std::strtod(text, nullptr);
  };
  for (const Recalibrated& c : r.recalibrated) {
    const bool of_cut = c.parameter == "radial_immersion_m" || c.parameter == "axial_depth_m";
    // A depth that only the lag of the helix tells is reported, not changed: force goes with it.
    if (c.parameter == "axial_depth_m") continue;
    machine.set(of_cut ? "cut" : "tool", c.parameter, rounded(c.to),
                "+- " + printed(c.standard_error) + " (standard error)");
  }
  for (const FoundEffect& e : r.effects) {
    const CuttingEffectInfo* info = find_cutting_effect(e.name);
    if (info == nullptr) continue;
    const std::string section = "effect." + std::string(info->channel) + "." + e.name;
    for (std::size_t p = 0; p < e.parameters.size(); ++p) {
      const NamedValue& v = e.parameters[p];
      if (v.values.size() == 1) {
        machine.set(section, v.key, rounded(v.values[0]),
                    "+- " + printed(e.standard_errors[p].values[0]) + " (standard error)");
      } else {
        std::vector<double> values;
        for (const double x : v.values) values.push_back(rounded(x));
        machine.set(section, v.key, std::span<const double>(values));
      }
    }
    machine.set(section, "provenance",
                provenance + ", confidence " + printed(e.confidence) + ", gap " +
                    printed(e.gap_before) + " to " + printed(e.gap_after) + " " + r.gap_unit);
  }
}

}  // namespace servosense::reconcile
