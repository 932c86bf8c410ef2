#include "servosense/identify/constant_check.hpp"

#include <algorithm>
#include <cmath>

namespace servosense {
namespace {

// Conventions.
constexpr double kObserverCutoff_rad_s = 100;
constexpr double kLeastSpeed = 0.2;          // of the highest: slower, friction is no plain law
constexpr double kLeastAcceleration = 0.25;  // of the hardest so far
constexpr double kSlack_s = 0.02;            // without acceleration: the leg is over
constexpr double kStands_s = 0.3;
constexpr double kStandsBelow = 0.005;  // of the highest speed
constexpr double kBin_s = 4e-3;         // in a bin: fewer samples tell nothing
constexpr std::size_t kLeastBins = 3;
constexpr double kBinsPerOctave = 6;
constexpr double kFades_s = 100;      // the hardest acceleration: a collision is none for ever
constexpr double kSurelyOff = 4;      // standard errors
constexpr double kMostBeyond = 0.8;   // of the pairs
constexpr double kAtOnce = 0.6;       // of the drift: a step
constexpr double kOfMad = 1.4826;     // to a standard deviation, normal
constexpr double kOfMedian = 1.2533;  // standard error of a median over that of a mean, normal

/// Half way between the two in the middle: of few values the upper one is biased.
double between_the_middle(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  if (values.size() % 2 == 1) return *middle;
  return (*middle + *std::max_element(values.begin(), middle)) / 2;
}

DisturbanceObserverConfig of_motion(const DisturbanceObserverConfig& observer,
                                    double DriveModelConfig::*parameter) {
  DisturbanceObserverConfig c = observer;
  c.drive = DriveModelConfig{};
  c.drive.*parameter = 1;
  return c;
}

}  // namespace

ConstantCheck::ConstantCheck(DisturbanceObserverConfig observer)
    : period_s_(observer.sample_period_s),
      inertia_(observer.drive.inertia),
      fade_(std::exp(-observer.sample_period_s / kFades_s)) {
  for (double* cutoff : {&observer.disturbance_cutoff_rad_s, &observer.velocity_cutoff_rad_s})
    *cutoff = std::min(*cutoff, kObserverCutoff_rad_s);
  estimate_.configure(observer);
  acceleration_.configure(of_motion(observer, &DriveModelConfig::inertia));
  speed_.configure(of_motion(observer, &DriveModelConfig::viscous));
}

void ConstantCheck::sample(const DriveSample<double>& sample, bool usable) {
  const double estimate = estimate_.process(sample);
  DriveSample<double> motion = sample;
  motion.effort = 0;
  // Observers read minus what a model of one takes.
  const double a = -acceleration_.process(motion), v = -speed_.process(motion);
  const Quality quality = estimate_.state().quality;
  if (!usable || has(quality, kUnusable | Quality::gap | Quality::settling)) return forget();
  const double speed = std::abs(v);
  highest_speed_ = std::max(highest_speed_, speed);
  standing_ = speed < kStandsBelow * highest_speed_ ? standing_ + 1 : 0;
  if (standing_ == static_cast<std::size_t>(kStands_s / period_s_)) ++stands_;
  hardest_ = std::max(fade_ * hardest_, std::abs(a));
  const int way = v > 0 ? 1 : -1;
  const int sense =
      std::abs(a) < kLeastAcceleration * hardest_ || !(speed > kLeastSpeed * highest_speed_)
          ? 0
          : (a > 0 ? way : -way);
  if (leg_.any && (way != way_ || (sense != 0 && sense != sense_))) end_leg();
  if (sense == 0) {
    if (leg_.any && static_cast<double>(++slack_) * period_s_ > kSlack_s) end_leg();
    return;
  }
  way_ = way;
  sense_ = sense;
  slack_ = 0;
  leg_.any = true;
  leg_.stands = stands_;
  Bin& bin = leg_.bins[static_cast<int>(std::floor(kBinsPerOctave * std::log2(speed)))];
  ++bin.n;
  bin.estimate += (estimate - bin.estimate) / bin.n;
  bin.acceleration += (a - bin.acceleration) / bin.n;
}

void ConstantCheck::forget() {
  leg_ = {};
  slack_ = 0;
}

void ConstantCheck::end_leg() {
  const double least = kBin_s / period_s_;
  std::erase_if(leg_.bins, [&](const auto& bin) { return bin.second.n < least; });
  if (leg_.bins.size() < kLeastBins) return forget();
  auto& of_way = last_[way_ > 0 ? 1 : 0];
  const Leg& other = of_way[sense_ > 0 ? 0 : 1];
  if (other.any) sense_ > 0 ? compare(leg_, other, leg_.stands) : compare(other, leg_, leg_.stands);
  of_way[sense_ > 0 ? 1 : 0] = leg_;
  forget();
}

void ConstantCheck::compare(const Leg& up, const Leg& down, std::size_t stands) {
  double xx = 0, xy = 0, friction = 0;
  std::size_t n = 0;
  const auto each = [&](auto take) {
    for (const auto& [at, u] : up.bins)
      if (const auto d = down.bins.find(at); d != down.bins.end())
        take(inertia_ * (u.acceleration - d->second.acceleration), u.estimate - d->second.estimate,
             u, d->second);
  };
  each([&](double x, double y, const Bin&, const Bin&) { xx += x * x, xy += x * y, ++n; });
  if (n < kLeastBins || !(xx > 0)) return;
  Pair pair;
  pair.drift = xy / xx;
  pair.stands = stands;
  double left = 0;
  each([&](double x, double y, const Bin& u, const Bin& d) {
    const double e = y - pair.drift * x;
    left += e * e;
    friction +=
        (u.estimate + d.estimate - pair.drift * inertia_ * (u.acceleration + d.acceleration)) / 2;
  });
  pair.standard_error = std::sqrt(left / static_cast<double>(n - 1) / xx);
  pair.friction = way_ * friction / static_cast<double>(n);
  pairs_.push_back(pair);
  judge();
}

ConstantDrift ConstantCheck::of(std::size_t from, std::size_t to) const {
  std::vector<double> drifts, errors, frictions, off;
  for (std::size_t i = from; i < to; ++i) {
    drifts.push_back(pairs_[i].drift);
    errors.push_back(pairs_[i].standard_error);
    frictions.push_back(pairs_[i].friction);
  }
  ConstantDrift d;
  d.pairs = drifts.size();
  d.drift = between_the_middle(drifts);
  d.friction = between_the_middle(frictions);
  for (const double x : drifts) off.push_back(std::abs(x - d.drift));
  d.standard_error = kOfMedian *
                     std::max(kOfMad * between_the_middle(off), between_the_middle(errors)) /
                     std::sqrt(static_cast<double>(d.pairs));
  return d;
}

void ConstantCheck::judge() {
  const std::size_t n = pairs_.size();
  if (n < kFewest) return;
  const std::size_t from = n > kWindow ? n - kWindow : 0;
  ConstantDrift& d = now_.emplace(of(from, n));
  const double sign = d.drift > 0 ? 1 : -1;
  const auto beyond =
      std::count_if(pairs_.begin() + static_cast<std::ptrdiff_t>(from), pairs_.end(),
                    [&](const Pair& pair) { return sign * pair.drift > kLeast; });
  d.beyond = sign * d.drift > std::max(kLeast, kSurelyOff * d.standard_error) &&
             static_cast<double>(beyond) >= kMostBeyond * static_cast<double>(d.pairs);
  if (!d.beyond) {
    stepped_.reset();
    return;
  }
  if (const std::size_t at = change(); at != 0) {
    const ConstantDrift before = of(at - kFewest, at), behind = of(at, at + kFewest);
    // The pair across the standstill itself is of both.
    const std::size_t last = std::min(at + 1, n - 1);
    if (pairs_[last].stands > pairs_[at - 2].stands &&
        sign * (behind.drift - before.drift) > kAtOnce * sign * d.drift) {
      d.step = true;
      d.before = before.drift;
      stepped_ = d;
    }
  }
  // Where it has stayed since, that is still the reason.
  if (!d.step && stepped_ && std::abs(d.drift - stepped_->drift) < (1 - kAtOnce) * sign * d.drift) {
    d.step = true;
    d.before = stepped_->before;
  }
}

// Where two medians fit the pairs best; 0: too few.
std::size_t ConstantCheck::change() const {
  const std::size_t n = pairs_.size(), from = n > 2 * kWindow ? n - 2 * kWindow : 0;
  const auto left = [&](std::size_t first, std::size_t to) {
    const double middle = of(first, to).drift;
    double sum = 0;
    for (std::size_t i = first; i < to; ++i) sum += std::abs(pairs_[i].drift - middle);
    return sum;
  };
  std::size_t best = 0;
  double least = 0;
  for (std::size_t at = from + kFewest; at + kFewest <= n; ++at) {
    const double sum = left(from, at) + left(at, n);
    if (best != 0 && !(sum < least)) continue;
    best = at;
    least = sum;
  }
  return best;
}

}  // namespace servosense
