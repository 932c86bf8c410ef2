#include "servosense/identify/effort_sign.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

namespace servosense {
namespace {

constexpr double kReach_s = 8e-3;       // counts of 4096 a turn tell 20 rad/s2 over it
constexpr double kCutFollows_s = 0.05;  // a cut changes with the path, not with the sample
constexpr double kClear = 3;            // times nearer than the other sign would be
constexpr double kStandstill = 1e-9;
constexpr Quality kBehindGap = Quality::gap | Quality::restarted;

}  // namespace

EffortSignConfig effort_sign_config(const DriveModelConfig& drive, double sample_period_s,
                                    double grain) {
  EffortSignConfig c;
  c.sample_period_s = sample_period_s;
  c.inertia = drive.inertia;
  c.viscous = drive.viscous;
  c.coulomb = drive.coulomb;
  c.constant_load = drive.constant_load;
  c.grain = std::abs(grain);
  return c;
}

EffortSign::EffortSign(const EffortSignConfig& config) : config_(config) {
  reach_ = std::max<std::size_t>(
      1, static_cast<std::size_t>(std::lround(kReach_s / config.sample_period_s)));
}

double EffortSign::sure_share() const {
  return answered_ > 0 ? static_cast<double>(sure_) / static_cast<double>(answered_) : 1;
}

void EffortSign::push(double increment, double magnitude) {
  Item item;
  item.position = (items_.empty() ? 0 : items_.back().position) + increment;
  item.magnitude = magnitude;
  items_.push_back(item);
  // Items before those that are looked at are dropped; the first positions stand for none.
  if (items_.size() > decided_ + reach_) {
    if (decided_ < reach_) {
      // The first samples wait for one that has neighbours on both sides.
      if (items_.size() > 2 * reach_) {
        decide(reach_);
        for (std::size_t k = 0; k < reach_; ++k) items_[k].answer = items_[reach_].answer;
        decided_ = reach_ + 1;
      }
    } else {
      decide(decided_);
      ++decided_;
    }
  }
  final_ = decided_ > reach_ ? decided_ - reach_ : 0;
}

EffortSign::Answer EffortSign::judge(double v, double a, double magnitude) {
  const int way = v > kStandstill ? 1 : v < -kStandstill ? -1 : 0;
  if (way == 0) return {sign_ == 0 ? 1 : sign_, false};
  if (!(config_.inertia > 0)) return {way, !(a * way < -config_.braking)};
  const double along = taken(v, a) * way;
  const double driving = magnitude - along, braking = -magnitude - along;
  Answer answer{way, true};
  if (along < 0) {
    const double by_driving = std::abs(driving - cut_), by_braking = std::abs(braking - cut_);
    if (by_braking < by_driving) answer.sign = -way;
    answer.sure = std::max(by_braking, by_driving) > kClear * std::min(by_braking, by_driving);
  }
  const double cut = answer.sign == way ? driving : braking;
  const double follows = std::min(1.0, config_.sample_period_s / kCutFollows_s);
  if (answer.sure) cut_ += follows * (std::max(0.0, cut) - cut_);
  return answer;
}

double EffortSign::taken(double v, double a) const {
  const int way = v > 0 ? 1 : v < 0 ? -1 : 0;
  return config_.inertia * a + config_.viscous * v + config_.coulomb * way + config_.constant_load;
}

// The path that the efforts ask for, with the old sign before a sample and the new one from it on,
// is held against the path that was measured, but for a parabola: where it began, how fast, and a
// load. Of the samples that fit as well, within two standard errors, the one with the least |u|.
std::size_t EffortSign::place_of_change(std::size_t i) const {
  constexpr double kAsGood = 4;  // of chi square, one parameter
  const double period = config_.sample_period_s, from = -static_cast<double>(reach_);
  const std::size_t n = 2 * reach_ + 1, first = i - reach_;
  const double square = from * (from - 1) / 3;  // mean of t^2 over -reach to reach
  const auto time = [&](std::size_t k) { return from + static_cast<double>(k); };
  double norm_1 = 0, norm_2 = 0;
  for (std::size_t k = 0; k < n; ++k) {
    const double t = time(k), p = t * t - square;
    norm_1 += t * t;
    norm_2 += p * p;
  }
  const auto left = [&](std::size_t change, std::vector<double>& path) {
    double velocity = 0, way = 0, mean = 0, slope = 0, bend = 0;
    for (std::size_t k = 0; k < n; ++k) {
      const Item& item = items_[first + k];
      path[k] = item.position - items_[first].position - way;
      const double sign = k < change ? sign_ : -sign_;
      velocity += sign * item.magnitude / config_.inertia * period * period;
      way += velocity;
      const double t = time(k);
      mean += path[k] / static_cast<double>(n);
      slope += path[k] * t / norm_1;
      bend += path[k] * (t * t - square) / norm_2;
    }
    double sum = 0;
    for (std::size_t k = 0; k < n; ++k) {
      const double t = time(k), r = path[k] - mean - slope * t - bend * (t * t - square);
      sum += r * r;
    }
    return sum;
  };
  std::vector<double> path(n), sums;
  for (std::size_t change = 1; change + 1 < n; ++change) sums.push_back(left(change, path));
  if (sums.empty()) return i;
  const double best = *std::min_element(sums.begin(), sums.end());
  const double noise = std::max(best / static_cast<double>(n), config_.grain * config_.grain / 12);
  std::size_t place = i;
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t k = 0; k < sums.size(); ++k) {
    const std::size_t at = first + 1 + k;
    if (sums[k] > best + kAsGood * noise || !(items_[at].magnitude < least)) continue;
    least = items_[at].magnitude;
    place = at;
  }
  return place;
}

void EffortSign::decide(std::size_t i) {
  const double span = static_cast<double>(reach_) * config_.sample_period_s;
  const double before = items_[i - reach_].position, at = items_[i].position,
               after = items_[i + reach_].position;
  Answer answer = judge((after - before) / (2 * span), (after - 2 * at + before) / (span * span),
                        items_[i].magnitude);
  if (sign_ == 0) sign_ = answer.sign;
  if (change_in_ > 0) {  // the sign has changed; it holds from the least effort on
    --change_in_;
    answer.sign = change_in_ > 0 ? -sign_ : sign_;
  } else if (answer.sign != sign_) {
    const std::size_t j = config_.inertia > 0 ? place_of_change(i) : i;
    sign_ = answer.sign;
    for (std::size_t k = std::max(j, final_); k < i; ++k) items_[k].answer.sign = sign_;
    if (j > i) {
      change_in_ = j - i;
      answer.sign = -sign_;
    }
  } else {
    answer.sign = sign_;
  }
  items_[i].answer = answer;
}

std::optional<EffortSign::Answer> EffortSign::pop() {
  const std::size_t ready = ended_ ? items_.size() : final_;
  if (given_ >= ready) return {};
  const Answer answer = items_[given_++].answer;
  ++answered_;
  if (answer.sure) ++sure_;
  // What lies before the neighbours of the next decision is done with.
  while (!ended_ && given_ > 2 * reach_ && decided_ > 2 * reach_) {
    items_.pop_front();
    --given_;
    --decided_;
    --final_;
  }
  return answer;
}

void EffortSign::finish() {
  ended_ = true;
  const Answer last = decided_ > 0 ? items_[decided_ - 1].answer : Answer{1, false};
  for (std::size_t k = decided_; k < items_.size(); ++k) items_[k].answer = last;
}

double resolve_signs(std::vector<DriveSample<double>>& samples, const EffortSignConfig& config,
                     Quality unsure) {
  std::uint64_t answered = 0, sure = 0;
  std::size_t at = 0;
  // Behind a gap a drive may be anywhere: every stretch by itself.
  for (std::size_t from = 0; from < samples.size();) {
    EffortSign sign(config);
    const auto take = [&] {
      while (const auto answer = sign.pop()) {
        DriveSample<double>& s = samples[at++];
        s.effort = answer->sign * std::abs(s.effort);
        sure += answer->sure;
        ++answered;
        if (!answer->sure) s.quality |= unsure;
      }
    };
    std::size_t to = from;
    do {
      sign.push(samples[to].increment, std::abs(samples[to].effort));
      take();
      ++to;
    } while (to < samples.size() && !has(samples[to].quality, kBehindGap));
    sign.finish();
    take();
    from = to;
  }
  return answered > 0 ? static_cast<double>(sure) / static_cast<double>(answered) : 1;
}

std::string signs_found(Channel drive, double sure_share) {
  char share[32];
  std::snprintf(share, sizeof share, "%.3g", 100 * sure_share);
  return std::string(name_of(drive)) +
         ": its effort is an absolute value; the sign is taken from the motion, surely for " +
         share + " % of the samples";
}

std::string signs_wanted(Channel drive) {
  return std::string(name_of(drive)) +
         ": its effort is never negative though the drive brakes or turns round; write "
         "current_is_unsigned = yes in [" +
         std::string(section_of(drive)) + "] if it is an absolute value, else no";
}

}  // namespace servosense
