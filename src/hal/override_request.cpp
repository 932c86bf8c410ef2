#include "servosense/hal/override_request.hpp"

#include <cmath>

namespace servosense {
namespace {

constexpr double kPercent = 0.01;
constexpr int kTries = 5;  // to give back what was changed

/// `ratio` of `base` in whole percents, the nearest that is no farther from `base`.
double whole_percents(double base, double ratio) {
  constexpr double kRounding = 1e-9;
  const double percents = base * ratio / kPercent;
  return kPercent *
         (ratio < 1 ? std::ceil(percents - kRounding) : std::floor(percents + kRounding));
}

bool differs(double a, double b) { return std::abs(a - b) > 0.6 * kPercent; }

}  // namespace

OverrideRequest::OverrideRequest(CncLink& link, OverrideRequestConfig config)
    : link_(link), config_(config) {}

void OverrideRequest::set(double speed_ratio, double feed_ratio) noexcept {
  speed_.store(speed_ratio, std::memory_order_relaxed);
  feed_.store(feed_ratio, std::memory_order_relaxed);
}

std::optional<double> OverrideRequest::turn() {
  const Nanoseconds now = link_.now_ns();
  if (!operator_) return look();
  if (seconds_from(now - looked_ns_) >= config_.look_s) return look();
  const double speed = speed_.load(std::memory_order_relaxed);
  const double feed = feed_.load(std::memory_order_relaxed);
  if (yielded_) {
    yielded_ = speed != 1 || feed != 1;
    return config_.look_s;
  }
  const bool faster = differs(whole_percents(operator_->speed, speed), sent_.speed);
  const bool fed = differs(whole_percents(operator_->feed, feed), sent_.feed);
  // What makes chips thinner first: less feed before less speed, more speed before more feed.
  const bool feed_first = whole_percents(operator_->feed, feed) < sent_.feed;
  if (fed && (feed_first || !faster)) return send(operator_->feed, feed, sent_.feed, false);
  if (faster) return send(operator_->speed, speed, sent_.speed, true);
  return config_.look_s;
}

std::optional<double> OverrideRequest::look() {
  CncOverrides now;
  const CncReply reply = link_.overrides(now);
  if (reply == CncReply::no_answer || reply == CncReply::reset) return std::nullopt;
  looked_ns_ = link_.now_ns();
  if (reply != CncReply::done) return config_.look_s;
  const Setting said{now.spindle, now.feed};
  if (!operator_) {
    operator_ = sent_ = said;
    return 0;
  }
  if (seconds_from(looked_ns_ - sent_ns_) < config_.settle_s) return 0;
  if (!differs(said.speed, sent_.speed) && !differs(said.feed, sent_.feed)) return 0;
  // Where he has left the other one alone, it goes back to what he had set there.
  if (differs(said.speed, sent_.speed)) operator_->speed = said.speed;
  if (differs(said.feed, sent_.feed)) operator_->feed = said.feed;
  sent_ = said;
  yielded_ = true;
  taken_over_ = true;
  feed_in_effect_ = 1;
  const std::lock_guard lock(mutex_);
  ++health_.takeovers;
  health_.speed = health_.feed = 1;
  return config_.look_s;
}

std::optional<double> OverrideRequest::send(double base, double ratio, double& acknowledged,
                                            bool spindle) {
  const double factor = whole_percents(base, ratio);
  const CncReply reply =
      spindle ? link_.set_spindle_override(factor) : link_.set_feed_override(factor);
  sent_ns_ = link_.now_ns();
  const std::lock_guard lock(mutex_);
  if (reply == CncReply::done) {
    acknowledged = factor;
    ++health_.commands;
    (spindle ? health_.speed : health_.feed) = factor / base;
    if (!spindle) feed_in_effect_ = factor / base;
    return 0;
  }
  if (reply == CncReply::busy) return config_.look_s;
  if (reply == CncReply::no_answer) return std::nullopt;
  ++health_.refused;
  return config_.look_s;
}

bool OverrideRequest::give_back() {
  set(1, 1);
  for (int n = 0; n < kTries && operator_; ++n) {
    yielded_ = false;
    const bool speed = !differs(operator_->speed, sent_.speed);
    if (speed && !differs(operator_->feed, sent_.feed)) return true;
    const bool sent = speed ? send(operator_->feed, 1, sent_.feed, false).has_value()
                            : send(operator_->speed, 1, sent_.speed, true).has_value();
    if (!sent) (void)link_.connect();
  }
  return !operator_ ||
         (!differs(operator_->speed, sent_.speed) && !differs(operator_->feed, sent_.feed));
}

OverrideHealth OverrideRequest::health() const {
  const std::lock_guard lock(mutex_);
  return health_;
}

}  // namespace servosense
