#include "servosense/hal/cnc_channel.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <thread>
#include <utility>

namespace servosense {
namespace {

constexpr double kLongestPause_s = 0.5;

// The number last and in brackets: a word that breaks off is an error, not another number.
std::string word(std::string_view letter, double value) {
  char text[40];
  std::snprintf(text, sizeof text, "[%.6f]", value);
  return std::string(letter) + text;
}

}  // namespace

Nanoseconds CncLink::now_ns() const {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
             std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

void CncLink::wait(double seconds) {
  std::this_thread::sleep_for(std::chrono::duration<double>(seconds));
}

CncChannel::CncChannel(CncLink& link, CncChannelConfig config)
    : link_(link), config_(std::move(config)) {}

Error CncChannel::error(const char* what, const std::string& why) const {
  return device_error(link_.name() + ": " + what + ' ' + why);
}

Expected<Done> CncChannel::repeat(const char* what, const std::function<CncReply()>& one) {
  ++health_.commands;
  const auto given_up = [&] {
    return error(what, "is void: the controller was reset or taken over; begin again");
  };
  double pause_s = config_.pause_s;
  bool connected = true;
  for (unsigned n = 0; n < config_.tries; ++n) {
    if (n > 0) {
      ++health_.repeated;
      link_.wait(pause_s);
      pause_s = std::min(2 * pause_s, kLongestPause_s);
    }
    if (!connected) {
      // Before anything is said again, what was said before must be forgotten.
      ++health_.connections;
      const CncReply reply = link_.connect();
      if (reply == CncReply::reset) return given_up();
      connected = reply == CncReply::done;
      if (!connected) continue;
    }
    switch (one()) {
      case CncReply::done:
        return Done{};
      case CncReply::busy:
        ++health_.busy;
        break;
      case CncReply::refused:
        ++health_.refused;
        return error(what, "is refused; is the machine on, and in the mode that allows it?");
      case CncReply::reset:
        return given_up();
      case CncReply::no_answer:
        ++health_.no_answer;
        connected = false;
        break;
    }
  }
  return error(what, "was tried " + std::to_string(config_.tries) +
                         " times and never acknowledged; check the connection");
}

Expected<Done> CncChannel::send_block(const char* what, const std::string& block) {
  const std::string text = block + '\n';
  std::size_t sent = 0;
  return repeat(what, [&] {
    for (;;) {
      std::size_t taken = 0;
      const CncReply reply = link_.send(std::string_view(text).substr(sent), taken);
      if (reply == CncReply::done || reply == CncReply::busy)
        sent += std::min(taken, text.size() - sent);
      else
        sent = 0;  // what had come of it is forgotten with the next connection
      if (reply != CncReply::done || sent == text.size()) return reply;
      ++health_.in_part;
      if (taken == 0) return CncReply::busy;
    }
  });
}

Expected<Done> CncChannel::open() {
  const Nanoseconds end = link_.now_ns() + nanoseconds_from(config_.operator_timeout_s);
  for (double pause_s = config_.pause_s; link_.now_ns() < end;
       pause_s = std::min(2 * pause_s, kLongestPause_s)) {
    ++health_.connections;
    if (link_.connect() == CncReply::done) return Done{};
    link_.wait(pause_s);
  }
  return error("control", "is not handed over; switch the machine on and let the program go");
}

Expected<CncStatus> CncChannel::status() {
  CncStatus status;
  if (auto done = repeat("the state", [&] { return link_.status(status); }); !done)
    return done.error();
  return status;
}

// After a block, nothing moves at first, and at zero speed little says that nothing will: Dunwoody
// (2010, app. A) waits 200 ms and then for five looks in a row.
Expected<Done> CncChannel::wait_until_still(const char* what, double limit_s) {
  const Nanoseconds end = link_.now_ns() + nanoseconds_from(limit_s);
  link_.wait(config_.settle_s);
  for (unsigned still = 0;;) {
    const auto now = status();
    if (!now) return now.error();
    if (!now->on) return error(what, "ended: the machine is off");
    still = now->moving ? 0 : still + 1;
    if (still >= config_.looks) return Done{};
    if (link_.now_ns() >= end)
      return error(what, now->feed_held ? "waits: the feed is held; release it"
                                        : "takes too long; is the feed override at zero?");
    link_.wait(config_.poll_s);
  }
}

Expected<Done> CncChannel::orient_spindle(double angle_rad) {
  if (!std::isfinite(angle_rad)) return usage_error("a spindle angle must be a number");
  double degrees = std::remainder(angle_rad, kTwoPi) * 180 / kPi;
  if (degrees < 0) degrees += 360;
  if (auto done = send_block("to orient the spindle", word(config_.orient_words, degrees)); !done)
    return done;
  return wait_until_still("to orient the spindle", config_.orient_timeout_s);
}

Expected<Done> CncChannel::jog(Channel axis, double distance_m, double feed_m_s) {
  if (axis != Channel::x && axis != Channel::y && axis != Channel::z)
    return usage_error("only x, y and z can be jogged");
  if (!(std::abs(distance_m) <= config_.longest_move_m))
    return usage_error("a jog goes " + std::to_string(1000 * config_.longest_move_m) +
                       " mm at most");
  if (!(feed_m_s > 0 && feed_m_s <= config_.greatest_feed_m_s))
    return usage_error("the feed of a jog is positive and at most " +
                       std::to_string(60000 * config_.greatest_feed_m_s) + " mm/min");
  const auto now = status();
  if (!now) return now.error();
  if (!now->on) return error("the jog", "cannot begin: the machine is off");
  if (now->moving) return error("the jog", "cannot begin: the machine is moving");
  axis_ = static_cast<std::size_t>(axis) - static_cast<std::size_t>(Channel::x);
  target_m_ = now->position_m[axis_] + distance_m;
  limit_s_ = config_.motion_margin_s +
             std::abs(distance_m) / (feed_m_s * std::clamp(now->feed_override, 0.01, 1.0));
  return send_block("the jog", config_.move_words + word(" F", 60000 * feed_m_s) +
                                   word(std::string(" ") + "XYZ"[axis_], 1000 * target_m_));
}

Expected<double> CncChannel::distance_to_go_m() {
  const auto now = status();
  if (!now) return now.error();
  return target_m_ - now->position_m[axis_];
}

Expected<Done> CncChannel::wait_until_there() {
  if (auto done = wait_until_still("the jog", limit_s_); !done) return done;
  const auto left = distance_to_go_m();
  if (!left) return left.error();
  if (std::abs(*left) > config_.arrived_m)
    return error("the jog", "ended " + std::to_string(1e6 * *left) +
                                " um before its end; see what the controller says");
  return Done{};
}

Expected<Done> CncChannel::hold_feed() {
  return repeat("the feed hold", [&] { return link_.hold_feed(true); });
}

Expected<Done> CncChannel::release_feed() {
  return repeat("to release the feed", [&] { return link_.hold_feed(false); });
}

Expected<Done> CncChannel::override_feed(double factor) {
  if (!(factor >= 0 && factor <= 2))
    return usage_error("a feed override is 0 to 2, 1 being the programmed feed");
  return repeat("the feed override", [&] { return link_.set_feed_override(factor); });
}

Expected<Done> CncChannel::turn_spindle(double speed_rad_s) {
  if (!std::isfinite(speed_rad_s)) return usage_error("a spindle speed must be a number");
  if (speed_rad_s == 0) return send_block("to stop the spindle", "M5");
  return send_block("to turn the spindle", word("S", rpm_from_rad_s(std::abs(speed_rad_s))) +
                                               (speed_rad_s > 0 ? " M3" : " M4"));
}

}  // namespace servosense
