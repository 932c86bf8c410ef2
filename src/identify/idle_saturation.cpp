#include "idle_saturation.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <iterator>

namespace servosense::idle_fit {
namespace {

constexpr double kSaturationEvidence = 5;  // standard errors; the best of many knees
constexpr double kBothShown = 3;           // likewise, of knee and share together
constexpr double kLeastLoss = 0.02;        // at the highest effort: less is within any constant's
constexpr double kToldWithin = 0.05;       // as of torque_constant_known_to_rpm
constexpr double kLowestKnee = 0.15;       // of the highest effort
constexpr double kHighestKnee = 0.95;      // likewise
constexpr double kProbe = 0.5;             // likewise
constexpr double kHighest = 0.995;         // quantile: a few may be off
// Knees at which a saturation of any knee shows, and in how many standard errors at the least: one
// that is taken showed in 9 or more, what is none in 1 at most (tests/cli/test_torque_saturation).
constexpr double kShowsAt[] = {kProbe, 0.8};
constexpr double kShows = 1.5;
constexpr int kKneeGrid = 17;
constexpr double kAsWell = 4;     // standard errors: knees that fit worse do not count
constexpr double kFinest = 1e-3;  // of the highest effort

double over(double u, double knee) { return u > knee ? u - knee : u < -knee ? u + knee : 0; }
double beyond(double u, double knee) { return u > knee ? 1 : u < -knee ? -1 : 0; }

Column combined(const Columns& columns, const Eigen::VectorXd& parameters) {
  Column sum(columns.front()->size(), 0.0);
  for (std::size_t j = 0; j < columns.size(); ++j)
    for (std::size_t i = 0; i < sum.size(); ++i)
      sum[i] += parameters(static_cast<Eigen::Index>(j)) * (*columns[j])[i];
  return sum;
}

class Knees {
 public:
  Knees(const IdleDesign& design, const Columns& columns)
      : design_(design), columns_(columns), effort_(design.efforts()) {
    const Regression fit = regress(columns, design.output, 0);
    motion_ = combined(columns, fit.parameters);
    // Current per torque, where the field is weakened.
    per_current_ = design.reading(Column(effort_.size(), 1.0));
    std::vector<double> sizes;
    for (std::size_t i = 0; i < motion_.size(); ++i) {
      const double v = design.viscous[i];
      drag_.push_back(v * std::abs(v));
      loaded_.push_back(v < 0 ? -std::abs(motion_[i]) : std::abs(motion_[i]));
      sizes.push_back(std::abs(asked(i)));
    }
    const auto at = static_cast<std::ptrdiff_t>(kHighest * static_cast<double>(sizes.size() - 1));
    std::nth_element(sizes.begin(), sizes.begin() + at, sizes.end());
    highest_ = sizes[static_cast<std::size_t>(at)];
    late_ = design.delay(fit.parameters(0), fit.parameters(1));
    for (const Column* other : {&drag_, &loaded_, &late_}) columns_.push_back(other);
  }

  [[nodiscard]] double highest() const { return highest_; }
  [[nodiscard]] double residual_of_constant() const {
    return regress(columns_, design_.output, 0).residual_rms;
  }

  [[nodiscard]] double residual(double knee) const { return with(knee, false, false).residual_rms; }
  /// With this knee; the share that is lost is parameter `share()`, then that of the knee if asked.
  /// The residual is that of over(u) itself.
  [[nodiscard]] Regression with(double knee, bool and_knee, bool with_errors) const {
    Column excess = effort_, step = effort_;
    for (double& u : excess) u = over(u, knee);
    for (double& u : step) u = beyond(u, knee);
    excess = design_.reading(excess);
    if (and_knee) step = design_.reading(step);
    // What the motion says of both.
    Column by_excess = motion_, by_step = motion_;
    for (std::size_t i = 0; i < motion_.size(); ++i) {
      by_excess[i] = over(asked(i), knee) * per_current_[i];
      by_step[i] = beyond(asked(i), knee) * per_current_[i];
    }
    Columns said = columns_;
    said.push_back(&by_excess);
    if (and_knee) said.push_back(&by_step);
    const Column shown = combined(said, regress(said, excess, 0).parameters);
    if (and_knee) step = combined(said, regress(said, step, 0).parameters);
    Columns all = columns_;
    all.push_back(&shown);
    if (and_knee) all.push_back(&step);
    Regression r = regress(all, design_.output, with_errors ? design_.lag() : 0);
    all[columns_.size()] = &excess;
    const Column fitted = combined(all, r.parameters);
    double square = 0;
    for (std::size_t i = 0; i < fitted.size(); ++i)
      square += (design_.output[i] - fitted[i]) * (design_.output[i] - fitted[i]);
    r.residual_rms = std::sqrt(square / static_cast<double>(fitted.size()));
    return r;
  }
  [[nodiscard]] Eigen::Index share() const { return static_cast<Eigen::Index>(columns_.size()); }

 private:
  [[nodiscard]] double asked(std::size_t row) const { return motion_[row] / per_current_[row]; }

  const IdleDesign& design_;
  Columns columns_;
  Column effort_;                // of the samples
  Column motion_, per_current_;  // of the rows
  Column drag_, loaded_, late_;
  double highest_ = 0;
};

}  // namespace

SeenSaturation find_saturation(const IdleDesign& design, const Columns& columns,
                               const IdleDesign& slower, const Columns& slower_columns,
                               std::optional<double> near) {
  const Knees knees(design, columns);
  const Knees slow(slower, slower_columns);
  // With this knee; what half the cutoff makes of it is added to the error (Hausman 1978).
  const auto lost_beyond = [&](double knee) {
    const auto of = [&](const Knees& all) {
      const Regression r = all.with(knee, false, true);
      return Estimate{r.parameters(all.share()), r.standard_errors(all.share())};
    };
    Estimate lost = of(knees);
    const Estimate other = of(slow);
    const double moved = other.value - lost.value;
    const double noise =
        other.standard_error * other.standard_error - lost.standard_error * lost.standard_error;
    lost.standard_error = std::hypot(
        lost.standard_error, std::sqrt(std::max(0.0, moved * moved - std::max(0.0, noise))));
    return lost;
  };
  SeenSaturation seen;
  seen.highest = knees.highest();
  seen.loss_error = (1 - kProbe) * lost_beyond(kProbe * seen.highest).standard_error;
  seen.told = kSaturationEvidence * seen.loss_error < kToldWithin;

  const auto shows = [&](double probe) {
    const Regression r = knees.with(probe * seen.highest, false, true);
    return r.parameters(knees.share()) > kShows * r.standard_errors(knees.share());
  };
  if (!near && std::none_of(std::begin(kShowsAt), std::end(kShowsAt), shows)) return seen;

  const double lowest = kLowestKnee * seen.highest, most = kHighestKnee * seen.highest;
  const double apart = (most - lowest) / (kKneeGrid - 1);
  double knee = near ? std::clamp(*near, lowest, most) : lowest;
  double least = knees.residual(knee);
  for (int i = 1; i < kKneeGrid && !near; ++i) {
    const double tried = lowest + apart * i;
    if (const double r = knees.residual(tried); r < least) least = r, knee = tried;
  }
  if (!(least < knees.residual_of_constant())) return seen;
  for (double step = apart / 2; step > kFinest * seen.highest; step /= 2)
    for (const double tried : {knee - step, knee + step})
      if (tried >= lowest && tried <= most)
        if (const double r = knees.residual(tried); r < least) {
          least = r, knee = tried;
          break;
        }
  const Estimate lost = lost_beyond(knee);
  if (!(lost.value > kSaturationEvidence * lost.standard_error)) return seen;
  if (!(lost.value * (1 - knee / seen.highest) > kLeastLoss)) return seen;
  // The record has to show both: where it does not, one stands in for the other and for inertia.
  const Regression both = knees.with(knee, true, true);
  Estimate share{std::min(lost.value, 1.0),
                 std::max(both.standard_errors(knees.share()), lost.standard_error)};
  Estimate at{knee, both.standard_errors(knees.share() + 1) / lost.value};
  Eigen::Vector3d errors = both.standard_errors.head<3>();
  // Nor are both a straight line of the knee: with one that fits nearly as well everything moves,
  // by so much in so many standard errors; within one it may as well be so.
  const Regression here = knees.with(knee, false, false);
  const auto off = [&](const Regression& r) {
    return r.parameters(knees.share() + 1) / r.standard_errors(knees.share() + 1);
  };
  for (const double way : {-apart, apart})
    for (double tried = knee + way; tried >= lowest && tried <= most; tried += way) {
      const double apart_in_errors = std::abs(off(knees.with(tried, true, true)) - off(both));
      if (!(apart_in_errors < kAsWell)) break;
      const Regression there = knees.with(tried, false, false);
      const auto widen = [&](double& error, double moved) {
        error = std::max(error, std::abs(moved) / std::max(1.0, apart_in_errors));
      };
      widen(at.standard_error, tried - knee);
      widen(share.standard_error, there.parameters(knees.share()) - here.parameters(knees.share()));
      for (Eigen::Index i = 0; i < 3; ++i)
        widen(errors(i), there.parameters(i) - here.parameters(i));
    }
  const auto shown = [](const Estimate& e) { return e.value > kBothShown * e.standard_error; };
  seen.told = shown(share) && shown(at);
  if (seen.told) seen.found = FoundSaturation{at, share, errors};
  return seen;
}

}  // namespace servosense::idle_fit
