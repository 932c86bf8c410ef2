#include "reconcile/cut/transients.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <tuple>
#include <utility>

#include "dsp/dense.hpp"
#include "reconcile/numerics/least_squares.hpp"
#include "reconcile/numerics/levenberg_marquardt.hpp"
#include "servosense/core/units.hpp"
#include "servosense/sim/run_parallel.hpp"

namespace servosense::reconcile {
namespace {

constexpr double kEvenStep = 0.02;            // relative
constexpr std::size_t kMostSamples = 200000;  // some seconds of search
constexpr std::size_t kLeastPassTurns = 4;    // of a pass
constexpr double kHighest_hz = 4000;
constexpr std::size_t kRingsRefined = 3;
constexpr double kRingRatio = 1.06, kRingDamping = 0.04;  // of a scan

}  // namespace

CutTransients::CutTransients(const CuttingData& d, const CutAverage& average, const CutState& state,
                             const Criteria& criteria) {
  const std::size_t n = d.time_s.size();
  if (n < 200 || n > kMostSamples || average.levels.size() < 2 || state.sensor) return;
  step_s_ = (d.time_s.back() - d.time_s.front()) / static_cast<double>(n - 1);
  double slowest = std::numeric_limits<double>::infinity();
  for (const CutLevel& level : average.levels) {
    if (!(level.samples_per_turn > 0)) return;
    slowest = std::min(slowest, level.speed_rad_s);
  }
  for (std::size_t i = 0; i < n; ++i)
    if (!std::isfinite(d.angle_rad[i]) ||
        (i > 0 && !(std::abs(d.time_s[i] - d.time_s[i - 1] - step_s_) < kEvenStep * step_s_)))
      return;
  angle_rad_ = d.angle_rad;
  for (const auto& [force, sign, out] : {std::tuple{&d.force_x_N, state.sign_x, &force_N_[0]},
                                         std::tuple{&d.force_y_N, state.sign_y, &force_N_[1]}})
    for (std::size_t i = 0; i < n; ++i)
      out->push_back(d.valid[i] ? sign * (*force)[i] : i > 0 ? out->back() : 0);

  const std::vector<char> at_level = find_passes(d, average, criteria);
  const std::vector<Eigen::VectorXd> seen = add_levels(average, state);
  lowest_hz_ = 1.5 * slowest / kTwoPi;
  highest_hz_ = std::min(0.4 / step_s_, kHighest_hz);
  score(d, average, state, at_level, seen);
}

/// Stretches at one feed: the level of each sample is that of the nearest. True where it is that.
std::vector<char> CutTransients::find_passes(const CuttingData& d, const CutAverage& average,
                                             const Criteria& criteria) {
  const std::size_t n = d.time_s.size();
  std::vector<char> at_level(n, 0);
  for (std::size_t i = 0; i < n; ++i) {
    std::size_t nearest = 0;
    double off = std::numeric_limits<double>::infinity();
    for (std::size_t l = 0; l < average.levels.size(); ++l) {
      const double o = std::abs(d.feed_per_tooth_m[i] / average.levels[l].feed_per_tooth_m - 1);
      if (o < off) {
        off = o;
        nearest = l;
      }
    }
    at_level[i] = d.valid[i] && off < criteria.same_feed ? 1 : 0;
    if (passes_.empty() || (passes_.back().level != nearest && off < criteria.same_feed))
      passes_.push_back({i, i, nearest});
    passes_.back().last = i + 1;
  }
  return at_level;
}

/// Forces of each level over the grid; what the sensor sees of them.
std::vector<Eigen::VectorXd> CutTransients::add_levels(const CutAverage& average,
                                                       const CutState& state) {
  CutState rigid = state;
  rigid.structure = {};
  rigid.blur_rad = kTwoPi / static_cast<double>(kCutGrid);
  rigid.sign_x = rigid.sign_y = 1;
  const Eigen::Map<const Eigen::Vector4d> coefficients(state.coefficients.data());
  const double kt = coefficients(0), kr = coefficients(1);
  std::vector<double> grid;
  for (Eigen::Index i = 0; i < kCutGrid; ++i)
    grid.push_back(kTwoPi * (static_cast<double>(i) + 0.5) / static_cast<double>(kCutGrid));
  std::vector<Eigen::VectorXd> seen;
  for (const CutLevel& level : average.levels) {
    Level l;
    const auto forces = [&](const CutState& s) {
      return Eigen::VectorXd(force_columns(s, level.feed_per_tooth_m, level.speed_rad_s, grid) *
                             coefficients.head(state.columns()));
    };
    const Eigen::VectorXd both = forces(rigid);
    l.rigid_N[0] = both.head(kCutGrid);
    l.rigid_N[1] = both.tail(kCutGrid);
    seen.push_back(forces(state));
    l.speed_rad_s = level.speed_rad_s;
    std::map<double, std::size_t> index;
    for (const Contact& c : contacts_of(state, level.feed_per_tooth_m)) {
      const auto [it, fresh] = index.try_emplace(c.back, l.memories.size());
      if (fresh)
        l.memories.push_back(
            {c.back, std::vector<std::array<double, 4>>(static_cast<std::size_t>(kCutGrid))});
      l.memories[it->second].N_per_m[static_cast<std::size_t>(c.at)] = {
          -kt * c.sc_m - kr * c.ss_m, kt * c.ss_m - kr * c.sc_m, -kt * c.cc_m - kr * c.sc_m,
          kt * c.sc_m - kr * c.cc_m};
    }
    levels_.push_back(std::move(l));
  }
  cutting_stiffness_N_per_m_ = std::abs(kt) * state.cut.axial_depth_m;
  return seen;
}

/// What is compared: measured forces less steady ones and means.
void CutTransients::score(const CuttingData& d, const CutAverage& average, const CutState& state,
                          const std::vector<char>& at_level,
                          const std::vector<Eigen::VectorXd>& seen) {
  const std::size_t n = d.time_s.size();
  scored_.assign(n, 0);
  mean_of_.assign(n, 0);
  measured_ = steady_ = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(2 * n));
  for (std::size_t p = 0; p < passes_.size(); ++p) {
    const Pass& pass = passes_[p];
    const CutLevel& level = average.levels[pass.level];
    const auto parts = std::min(average.bins, static_cast<std::size_t>(level.samples_per_turn));
    const double per_tooth = level.samples_per_turn / state.tool.teeth;
    const bool enough = static_cast<double>(pass.last - pass.first) >
                        static_cast<double>(kLeastPassTurns) * level.samples_per_turn;
    if (enough)
      shortest_s_ = std::min(shortest_s_, step_s_ * static_cast<double>(pass.last - pass.first));
    for (std::size_t i = pass.first; i < pass.last; ++i) {
      const double turn = d.angle_rad[i] / kTwoPi, part = turn - std::floor(turn);
      mean_of_[i] =
          means_ + std::min(parts - 1, static_cast<std::size_t>(part * static_cast<double>(parts)));
      // How the feed passes from one tooth to the next is not known.
      const bool changing = p > 0 && static_cast<double>(i - pass.first) < per_tooth + 1;
      if (!enough || !at_level[i] || changing) continue;
      scored_[i] = d.time_s[i] < average.held_from_s ? 1 : 2;
      const auto row = static_cast<Eigen::Index>(i);
      const Eigen::Index g = grid_index(d.angle_rad[i]);
      const Eigen::VectorXd& model = seen[pass.level];
      const Eigen::Index other = static_cast<Eigen::Index>(n) + row;
      steady_(row) = state.sign_x * model(g);
      steady_(other) = state.sign_y * model(kCutGrid + g);
      measured_(row) = state.sign_x * d.force_x_N[i] - steady_(row);
      measured_(other) = state.sign_y * d.force_y_N[i] - steady_(other);
    }
    means_ += parts;
  }
  take_off_means(measured_);
  std::vector<double> together(means_, 0);
  for (std::size_t i = 0; i < n; ++i)
    if (scored_[i] != 0) ++together[mean_of_[i]];
  for (std::size_t i = 0; i < n; ++i)
    if (scored_[i] != 0) freedom_[scored_[i] == 2 ? 1 : 0] += 2 * (1 - 1 / together[mean_of_[i]]);
}

void CutTransients::take_off_means(Eigen::VectorXd& xy) const {
  const std::size_t n = scored_.size();
  for (const std::size_t from : {std::size_t{0}, n}) {
    std::vector<double> sum(means_, 0), count(means_, 0);
    for (std::size_t i = 0; i < n; ++i) {
      double& value = xy(static_cast<Eigen::Index>(from + i));
      if (scored_[i] == 0) {
        value = 0;
        continue;
      }
      sum[mean_of_[i]] += value;
      ++count[mean_of_[i]];
    }
    for (std::size_t i = 0; i < n; ++i)
      if (scored_[i] != 0)
        xy(static_cast<Eigen::Index>(from + i)) -= sum[mean_of_[i]] / count[mean_of_[i]];
  }
}

double CutTransients::share_of_modulation(double turns) const {
  const std::size_t n = scored_.size();
  const auto wave = [&](double phase) {
    Eigen::VectorXd xy = steady_;
    for (std::size_t i = 0; i < n; ++i) {
      const double factor = std::sin(angle_rad_[i] / turns + phase);
      xy(static_cast<Eigen::Index>(i)) *= factor;
      xy(static_cast<Eigen::Index>(n + i)) *= factor;
    }
    take_off_means(xy);
    return xy;
  };
  const Eigen::VectorXd waves[] = {wave(0), wave(kTwoPi / 4)};
  Eigen::Matrix2d normal = Eigen::Matrix2d::Zero();
  Eigen::Vector2d right = Eigen::Vector2d::Zero();
  double all = 0;
  for (std::size_t i = 0; i < n; ++i) {
    if (scored_[i] != 1) continue;
    for (const std::size_t at : {i, n + i}) {
      const auto row = static_cast<Eigen::Index>(at);
      const Eigen::Vector2d both(waves[0](row), waves[1](row));
      normal += both * both.transpose();
      right += measured_(row) * both;
      all += measured_(row) * measured_(row);
    }
  }
  if (!(normal.determinant() > 0) || !(all > 0)) return 0;
  return right.dot(dense::solve_symmetric(normal, right)) / all;
}

/// The samples fitted.
Eigen::VectorXd CutTransients::compared(const Eigen::VectorXd& xy) const {
  Eigen::VectorXd out = xy;
  for (std::size_t i = 0; i < scored_.size(); ++i)
    if (scored_[i] != 1)
      out(static_cast<Eigen::Index>(i)) = out(static_cast<Eigen::Index>(scored_.size() + i)) = 0;
  return out;
}

/// Over the logarithms.
CutTransients::Judged CutTransients::refined(const Mode& mode, Start start) const {
  constexpr int kRounds = 12;
  constexpr double kSettled = 1e-6;  // relative change of the sum of squares
  const Eigen::VectorXd target = compared(measured_);
  std::vector<double> values = {std::log(mode.mode.natural_frequency_hz),
                                std::log(mode.mode.damping_ratio)};
  std::vector<BoundedParameter> parameters = {{std::log(lowest_hz_), std::log(highest_hz_), 1e-3},
                                              {std::log(2e-3), std::log(0.7), 1e-2}};
  if (!mode.of_sensor) {  // no force goes with the mass of a sensor
    values.push_back(std::log(mode.mode.modal_mass_kg));
    parameters.push_back({std::log(1e-4), std::log(1e5), 1e-2});
  }
  const auto with = [&](const std::vector<double>& v) {
    const double mass = mode.of_sensor ? mode.mode.modal_mass_kg : std::exp(v[2]);
    return Mode{mode.axis, {std::exp(v[0]), std::exp(v[1]), mass}, mode.of_sensor, mode.driven};
  };
  const NonlinearFit fit = levenberg_marquardt(
      [&](const std::vector<double>& v) {
        return Eigen::VectorXd(target - compared(simulated(with(v), start)));
      },
      std::move(values), parameters, kRounds, kSettled);
  Judged best = judged(with(fit.values), start);
  const Eigen::VectorXd spread = dense::inverse(fit.normal).diagonal();
  for (std::size_t k = 0; k < parameters.size(); ++k)
    best.errors[k] = root(spread(static_cast<Eigen::Index>(k)));
  return best;
}

CutTransients::Judged CutTransients::judged(const Mode& mode, Start start) const {
  return judged(mode, start, simulated(mode, start), measured_);
}

CutTransients::Judged CutTransients::judged(const Mode& mode, Start start, const Eigen::VectorXd& s,
                                            const Eigen::VectorXd& measured) const {
  Judged j{mode, start, {}, {}, 0, 0, {}, {}};
  double both = 0, square = 0;
  const std::size_t n = scored_.size();
  for (std::size_t i = 0; i < 2 * n; ++i) {
    const char part = scored_[i % n];
    if (part == 0) continue;
    const double m = measured(static_cast<Eigen::Index>(i)), v = s(static_cast<Eigen::Index>(i));
    std::array<double, 2>& sums = part == 1 ? j.fitted : j.held;
    sums[0] += m * m;
    sums[1] += (m - v) * (m - v);
    if (part == 2) {
      both += m * v;
      square += v * v;
    }
  }
  for (const Pass& pass : passes_) {
    double b = 0, q = 0;
    for (std::size_t i = pass.first; i < pass.last; ++i)
      for (const std::size_t from : {std::size_t{0}, n}) {
        if (scored_[i] == 0) continue;
        const auto row = static_cast<Eigen::Index>(from + i);
        b += measured(row) * s(row);
        q += s(row) * s(row);
      }
    j.part_of_pass.push_back({q > 0 ? b / q : 0, q > 0 ? 1 / std::sqrt(q) : 0});
  }
  j.held_part = both / std::max(1e-300, square);
  j.held_part_error = 1 / std::sqrt(std::max(1e-300, square));
  return j;
}

CutTransients::Judged CutTransients::best_mode(double worth_N2, unsigned threads) const {
  // A scan by the first order of the effect: its size is what the measurement asks for.
  std::vector<Trial> trials;
  for (double hz = lowest_hz_; hz < highest_hz_; hz *= kRingRatio)
    for (const double stiffness : {4.0, 12.0, 50.0})
      for (const std::size_t axis : {std::size_t{0}, std::size_t{1}})
        for (const bool from_rest : {true, false}) {
          const double w = kTwoPi * hz;
          trials.push_back(
              {{axis, {hz, kRingDamping, stiffness * cutting_stiffness_N_per_m_ / (w * w)}},
               {from_rest, false},
               0});
        }
  return best_of(std::move(trials), worth_N2, threads);
}

CutTransients::Judged CutTransients::best_sensor(std::size_t axis, double worth_N2,
                                                 unsigned threads) const {
  std::vector<Trial> trials;
  for (double hz = lowest_hz_; hz < highest_hz_; hz *= kRingRatio)
    for (const bool from_rest : {true, false})
      trials.push_back({{axis, {hz, kRingDamping, 1}, true}, {from_rest, false}, 0});
  return best_of(std::move(trials), worth_N2, threads);
}

CutTransients::Judged CutTransients::best_driven(double worth_N2, unsigned threads) const {
  constexpr double kScanRatio = 1.1, kDamping = 0.04;  // of the scan
  std::vector<Trial> trials;
  for (double hz = lowest_hz_; hz < highest_hz_; hz *= kScanRatio)
    for (const std::size_t axis : {std::size_t{0}, std::size_t{1}}) {
      const double w = kTwoPi * hz;
      trials.push_back(
          {{axis, {hz, kDamping, 10 * cutting_stiffness_N_per_m_ / (w * w)}, false, true}, {}, 0});
    }
  return best_of(std::move(trials), worth_N2, threads);
}

void CutTransients::size(Trial& trial, const Eigen::VectorXd& target) const {
  const Eigen::VectorXd shown = compared(simulated(trial.mode, trial.start));
  const double square = shown.squaredNorm(), both = shown.dot(target);
  if (!(square > 0) || !(both > 0)) return;
  double part = both / square;
  // Near the limit of stability the effect is not proportional any more.
  if (!trial.mode.driven && !trial.mode.of_sensor) part = std::clamp(part, 0.02, 1.5);
  trial.gain = part * (2 * both - part * square);
  if (!trial.mode.of_sensor) trial.mode.mode.modal_mass_kg /= part;  // else that of the force
}

CutTransients::Judged CutTransients::best_of(std::vector<Trial> trials, double worth_N2,
                                             unsigned threads) const {
  const Eigen::VectorXd target = compared(measured_);
  run_parallel(
      trials.size(), [&](std::size_t i) { size(trials[i], target); }, threads);
  std::stable_sort(trials.begin(), trials.end(),
                   [](const Trial& a, const Trial& b) { return a.gain > b.gain; });
  std::vector<Trial> kept;
  for (const Trial& t : trials) {
    if (std::all_of(kept.begin(), kept.end(), [&](const Trial& k) {
          return t.mode.driven || k.mode.axis != t.mode.axis ||
                 std::abs(std::log(k.mode.mode.natural_frequency_hz /
                                   t.mode.mode.natural_frequency_hz)) > 0.1;
        }))
      kept.push_back(t);
    if (kept.size() == kRingsRefined) break;
  }
  if (!(kept[0].gain > worth_N2)) return judged(kept[0].mode, kept[0].start);
  // What the measured force leads has no start that the record does not tell.
  const std::size_t starts = kept[0].mode.driven ? 1 : 2;
  std::vector<Judged> done(starts * kept.size());
  run_parallel(
      done.size(),
      [&](std::size_t i) {
        const Trial& t = kept[i / starts];
        Start start = t.start;
        start.gradual = i % starts == 1;
        start.fine = true;
        done[i] = refined(t.mode, start);
      },
      threads);
  return *std::min_element(done.begin(), done.end(), [](const Judged& a, const Judged& b) {
    return a.fitted[1] < b.fitted[1];
  });
}

}  // namespace servosense::reconcile
