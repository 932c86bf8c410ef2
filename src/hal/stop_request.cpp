#include "servosense/hal/stop_request.hpp"

#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

namespace servosense {
namespace {

constexpr Nanoseconds kNothing = std::numeric_limits<Nanoseconds>::min();

}  // namespace

StopRequest::StopRequest(CncLink& link, StopRequestConfig config, Complain complain, Beside beside)
    : link_(link),
      config_(config),
      complain_(std::move(complain)),
      beside_(std::move(beside)),
      wake_(eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)),
      arrival_(kNothing) {}

StopRequest::~StopRequest() {
  stop();
  if (wake_ >= 0) ::close(wake_);
}

void StopRequest::raise(Nanoseconds arrival_ns) noexcept {
  raised_.fetch_add(1, std::memory_order_relaxed);
  active_.store(true, std::memory_order_relaxed);
  Nanoseconds nothing = kNothing;
  // The first that is not taken yet is the one that counts.
  if (!arrival_.compare_exchange_strong(nothing, arrival_ns)) return;
  const std::uint64_t one = 1;
  [[maybe_unused]] const ssize_t n = ::write(wake_, &one, sizeof one);
}

void StopRequest::start() {
  if (thread_.joinable()) return;
  stopping_ = false;
  thread_ = std::thread([this] { run(); });
}

void StopRequest::stop() {
  stopping_ = true;
  const std::uint64_t one = 1;
  [[maybe_unused]] const ssize_t n = ::write(wake_, &one, sizeof one);
  if (thread_.joinable()) thread_.join();
}

void StopRequest::run() {
  Nanoseconds end = kNothing;
  for (;;) {
    const double wait_s = turn();
    if (stopping_) {
      // What is on its way may get there yet.
      if (end == kNothing) end = link_.now_ns() + nanoseconds_from(config_.finish_s);
      const bool unsettled = !said_ && phase_ != Phase::armed && !seen_;
      if (!unsettled && arrival_.load() == kNothing) return;
      if (link_.now_ns() >= end) return;
    }
    pollfd wake{wake_, POLLIN, 0};
    const int limit_ms = wait_s < 0 ? -1 : static_cast<int>(std::ceil(1000 * wait_s));
    if (::poll(&wake, 1, limit_ms) > 0) {
      std::uint64_t count = 0;
      [[maybe_unused]] const ssize_t n = ::read(wake_, &count, sizeof count);
    }
  }
}

double StopRequest::turn() {
  if (!connected_) connected_ = link_.connect() == CncReply::done;
  if (const Nanoseconds arrival = arrival_.exchange(kNothing); arrival != kNothing) begin(arrival);
  if (phase_ != Phase::armed) check_overdue();
  if (phase_ == Phase::asking) return ask();
  if (phase_ == Phase::held) return look_beside(watch());
  // Without a connection there is nothing to wait for: the next alarm finds one.
  return look_beside(connected_ ? -1 : 1);
}

double StopRequest::look_beside(double wait_s) {
  if (!beside_ || !connected_ || phase_ == Phase::asking) return wait_s;
  const std::optional<double> next_s = beside_();
  if (!next_s) {
    connected_ = false;
    return config_.watch_s;
  }
  return wait_s < 0 ? *next_s : std::min(wait_s, *next_s);
}

void StopRequest::begin(Nanoseconds arrival_ns) {
  const std::lock_guard lock(mutex_);
  if (phase_ != Phase::armed) {
    ++health_.joined;
    return;
  }
  active_ = true;
  ++health_.events;
  phase_ = Phase::asking;
  acknowledged_ = seen_ = said_ = looked_ = false;
  began_ns_ = arrival_ns;
}

double StopRequest::ask() {
  const CncReply reply = connected_ ? link_.hold_feed(true) : CncReply::no_answer;
  CncStatus status;
  bool in_effect = false;
  if (reply == CncReply::done) {
    const std::lock_guard lock(mutex_);
    ++health_.tries;
    if (!acknowledged_) {
      health_.reaction.add(link_.now_ns() - began_ns_);
      ++health_.held;
    }
    acknowledged_ = true;
  } else {
    const std::lock_guard lock(mutex_);
    if (connected_) ++health_.tries;
    connected_ = false;
  }
  // An acknowledgement is good, to see it is what counts.
  if (reply == CncReply::done) {
    told_ = link_.status(status) == CncReply::done;
    if (told_)
      in_effect = status.feed_held || !status.moving;
    else
      connected_ = false;
    if (in_effect) look(status);
  }
  const std::lock_guard lock(mutex_);
  const bool too_late = seconds_from(link_.now_ns() - began_ns_) > config_.give_up_s;
  if (in_effect && (seen_ || !too_late)) {
    phase_ = Phase::held;
    health_.holding = true;
    return config_.watch_s;
  }
  if (too_late) {
    ++health_.given_up;
    health_.holding = false;
    phase_ = Phase::armed;
    active_ = arrival_.load() != kNothing;
    return 0;
  }
  return config_.retry_s;
}

double StopRequest::watch() {
  CncStatus status;
  if (!connected_ || link_.status(status) != CncReply::done) {
    connected_ = false;  // held, for all we know
    return config_.watch_s;
  }
  if (!seen_) {
    if (!status.feed_held && status.moving) {
      phase_ = Phase::asking;  // it did not last
      looked_ = false;
      return config_.retry_s;
    }
    look(status);
    if (!seen_ && seconds_from(link_.now_ns() - began_ns_) > config_.braking_s)
      phase_ = Phase::asking;
    return config_.watch_s;
  }
  if (status.feed_held) return config_.watch_s;
  const std::lock_guard lock(mutex_);
  phase_ = Phase::armed;
  health_.holding = false;
  ++health_.released;
  active_ = arrival_.load() != kNothing;
  return 0;
}

/// What says that it is held, or moves nothing, stands when its position is that of the last look.
void StopRequest::look(const CncStatus& status) {
  bool stands = std::exchange(looked_, true);
  for (std::size_t i = 0; i < kAxes; ++i)
    stands = stands && std::abs(status.position_m[i] - last_m_[i]) <= config_.creep_m;
  last_m_ = status.position_m;
  if (!stands) return;
  seen_ = true;
  const std::lock_guard lock(mutex_);
  ++health_.seen;
}

void StopRequest::check_overdue() {
  const bool holds = phase_ == Phase::held;
  const double since_s = seconds_from(link_.now_ns() - began_ns_);
  if (seen_ || said_ || since_s <= (holds ? config_.braking_s : config_.effect_s)) return;
  said_ = true;
  {
    const std::lock_guard lock(mutex_);
    ++health_.overdue;
  }
  if (!complain_) return;
  complain_(link_.name() +
            (!acknowledged_ ? " does not acknowledge the feed hold"
             : !told_       ? " has acknowledged the feed hold and says no more"
             : holds        ? " says that the feed is held, and its axes move on"
                            : " acknowledges the feed hold and keeps running") +
            "; stop the machine by hand");
}

StopHealth StopRequest::health() const {
  const std::lock_guard lock(mutex_);
  StopHealth health = health_;
  health.raised = raised_;
  return health;
}

}  // namespace servosense
