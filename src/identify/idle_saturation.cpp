#include "idle_saturation.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

namespace servosense::idle_fit {
namespace {

constexpr double kSaturationEvidence = 5;  // standard errors; the best of many knees
constexpr double kLeastLoss = 0.02;        // at the highest effort: less is within any constant's
constexpr double kToldWithin = 0.05;       // as of torque_constant_known_to_rpm
constexpr double kLowestKnee = 0.15;       // of the highest effort
constexpr double kHighestKnee = 0.95;      // likewise
constexpr double kProbe = 0.5;             // likewise
constexpr double kHighest = 0.995;         // quantile: a few may be off
constexpr int kKneeGrid = 17;
constexpr int kKneeSteps = 6;  // of Gauss and Newton

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

  /// With this knee; the share that is lost is parameter `share()`, then that of the knee if asked.
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
    excess = combined(said, regress(said, excess, 0).parameters);
    if (and_knee) step = combined(said, regress(said, step, 0).parameters);
    Columns all = columns_;
    all.push_back(&excess);
    if (and_knee) all.push_back(&step);
    return regress(all, design_.output, with_errors ? design_.lag() : 0);
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

SeenSaturation find_saturation(const IdleDesign& design, const Columns& columns) {
  const Knees knees(design, columns);
  SeenSaturation seen;
  seen.highest = knees.highest();
  const Eigen::Index share = knees.share();
  const Regression probe = knees.with(kProbe * seen.highest, false, true);
  seen.loss_error = (1 - kProbe) * probe.standard_errors(share);
  seen.told = kSaturationEvidence * seen.loss_error < kToldWithin;

  const double lowest = kLowestKnee * seen.highest, most = kHighestKnee * seen.highest;
  double knee = lowest, least = 0;
  for (int i = 0; i < kKneeGrid; ++i) {
    const double tried = lowest + (most - lowest) * i / (kKneeGrid - 1);
    const Regression r = knees.with(tried, false, false);
    if (i == 0 || r.residual_rms < least) least = r.residual_rms, knee = tried;
  }
  if (!(least < knees.residual_of_constant())) return seen;
  for (int i = 0; i < kKneeSteps; ++i) {
    const Regression r = knees.with(knee, true, false);
    const double lost = r.parameters(share);
    if (!(lost > 0)) return seen;
    knee += std::clamp(-r.parameters(share + 1) / lost, -0.05 * seen.highest, 0.05 * seen.highest);
    knee = std::clamp(knee, lowest, most);
  }
  const Regression alone = knees.with(knee, false, true);
  const double lost = alone.parameters(share);
  if (!(lost > kSaturationEvidence * alone.standard_errors(share))) return seen;
  if (!(lost * (1 - knee / seen.highest) > kLeastLoss)) return seen;
  const Regression both = knees.with(knee, true, true);
  seen.found = FoundSaturation{{knee, both.standard_errors(share + 1) / lost},
                               {std::min(lost, 1.0), both.standard_errors(share)}};
  return seen;
}

}  // namespace servosense::idle_fit
