#include "servosense/hal/simulated_cnc.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <map>
#include <optional>
#include <random>

namespace servosense {
namespace {

constexpr std::size_t kBuffer = 256;  // characters that wait

// Words of a block: letters with a number, in brackets or not. Nothing when it makes no sense.
std::optional<std::multimap<char, double>> words_of(const std::string& block) {
  std::multimap<char, double> words;
  for (std::size_t at = 0; at < block.size();) {
    if (block[at] == ' ') {
      ++at;
      continue;
    }
    const char letter = block[at++];
    const bool bracket = at < block.size() && block[at] == '[';
    const char* const begin = block.c_str() + at + (bracket ? 1 : 0);
    char* end = nullptr;
    const double value = std::strtod(begin, &end);
    if (letter < 'A' || letter > 'Z' || end == begin || !std::isfinite(value)) return std::nullopt;
    if (bracket && *end++ != ']') return std::nullopt;
    at = static_cast<std::size_t>(end - block.c_str());
    words.emplace(letter, value);
  }
  return words;
}

}  // namespace

struct SimulatedCnc::Content {
  SimulatedCncConfig config;
  std::string name = "the simulated CNC";
  std::mt19937 random;
  SimulatedCncTruth truth;
  CncStatus state;
  double spindle_override = 1;
  Nanoseconds now = 0;
  Nanoseconds last_clock = 0;
  double rest_s = 0;  // of the time waited, less than a step
  std::string text;   // blocks that wait, and what is no whole block yet
  bool in_reset = false;
  std::size_t axis = 0;
  double target_m = 0, feed_m_s = 0, speed_m_s = 0;
  double oriented_in_s = 0;
  double modal_feed_m_s = 0;

  bool chance(double share) { return static_cast<double>(random()) < share * 4294967296.0; }
  // Real time goes on whether it is waited for or not.
  void catch_up(const SimulatedCnc& self) {
    if (!config.real_time) return;
    const Nanoseconds clock = self.now_ns();
    if (last_clock != 0) run(seconds_from(clock - last_clock));
    last_clock = clock;
  }
  void pass(SimulatedCnc& self, double seconds) {
    if (!config.real_time) return run(seconds);
    self.CncLink::wait(seconds);
    catch_up(self);
  }
  void run(double seconds) {
    now += nanoseconds_from(seconds);
    rest_s += seconds;
    for (; rest_s >= config.step_s; rest_s -= config.step_s) step();
  }
  void step() {
    const double dt = config.step_s;
    if (const std::size_t end = text.find('\n'); !state.moving && end != std::string::npos) {
      carry_out(text.substr(0, end));
      text.erase(0, end + 1);
    }
    if (oriented_in_s > 0 && !state.feed_held) oriented_in_s -= dt;
    const double left = target_m - state.position_m[axis];
    const double brake = config.acceleration_m_s2 * dt;
    // The fastest from which it can still stop at the target, within this step's own way.
    const double may = std::sqrt(2 * config.acceleration_m_s2 * std::abs(left));
    double wanted = state.feed_held ? 0 : std::min(feed_m_s * state.feed_override, may);
    wanted = std::copysign(wanted, left);
    speed_m_s = std::clamp(wanted, speed_m_s - brake, speed_m_s + brake);
    double way = speed_m_s * dt;
    if (std::abs(way) >= std::abs(left) || (std::abs(left) < 1e-9 && !state.feed_held)) {
      way = left;
      speed_m_s = 0;
    }
    state.position_m[axis] += way;
    truth.path_m += std::abs(way);
    truth.speed_m_s = std::abs(speed_m_s);
    state.moving = speed_m_s != 0 || state.position_m[axis] != target_m || oriented_in_s > 0;
  }
  void stop_dead() {
    target_m = state.position_m[axis];
    speed_m_s = truth.speed_m_s = oriented_in_s = 0;
    state.moving = false;
    text.clear();
  }
  void carry_out(const std::string& block) {
    const auto words = words_of(block);
    bool known = words.has_value();
    double degrees = 0;
    std::optional<int> spindle;
    bool orient = false;
    std::optional<double> speed;
    std::optional<std::pair<std::size_t, double>> to;
    if (words)
      for (const auto& [letter, value] : *words) {
        if (letter == 'F')
          modal_feed_m_s = value / 60000;
        else if (letter == 'S')
          speed = rad_s_from_rpm(value);
        else if (letter == 'R')
          degrees = value;
        else if (letter >= 'X' && letter <= 'Z')
          to = {static_cast<std::size_t>(letter - 'X'), value / 1000};
        else if (letter == 'M' && value == 19)
          orient = true;
        else if (letter == 'M' && value >= 3 && value <= 5)
          spindle = static_cast<int>(value);
        else if (letter != 'G' ||
                 (value != 21 && value != 90 && value != 94 && value != 53 && value != 1))
          known = false;
      }
    if (!known || (to && modal_feed_m_s <= 0)) {
      ++truth.bad_blocks;
      return;
    }
    ++truth.blocks;
    if (orient) {
      oriented_in_s = config.orient_s;
      truth.spindle_angle_rad = rad_from_deg(degrees);
      truth.spindle_speed_rad_s = 0;
    }
    if (spindle)
      truth.spindle_speed_rad_s = *spindle == 5 ? 0 : (*spindle == 3 ? 1 : -1) * speed.value_or(0);
    if (to) {
      axis = to->first;
      target_m = to->second;
      feed_m_s = modal_feed_m_s;
    }
    state.moving = state.moving || orient || (to && target_m != state.position_m[axis]);
  }
  /// One try of anything that `act` does when it arrives.
  template <typename Act>
  CncReply attempt(SimulatedCnc& self, Act act) {
    catch_up(self);
    ++truth.tries;
    if (chance(config.lost_request)) {
      ++truth.lost;
      pass(self, config.time_limit_s);
      return CncReply::no_answer;
    }
    pass(self, config.reply_s / 2);
    CncReply reply = CncReply::done;
    if (chance(config.reset)) {
      stop_dead();
      in_reset = true;
    }
    if (in_reset)
      reply = CncReply::reset;
    else
      reply = act();
    if (chance(config.lost_reply)) {
      ++truth.lost;
      pass(self, config.time_limit_s);
      return CncReply::no_answer;
    }
    pass(self,
         config.reply_s / 2 + config.reply_jitter_s * static_cast<double>(random()) / 4294967296.0);
    return reply;
  }
};

SimulatedCnc::SimulatedCnc(const SimulatedCncConfig& config)
    : content_(std::make_unique<Content>()) {
  content_->config = config;
  content_->random.seed(config.seed);
  content_->state.on = true;
}
SimulatedCnc::~SimulatedCnc() = default;

const std::string& SimulatedCnc::name() const { return content_->name; }

CncReply SimulatedCnc::connect() {
  Content& c = *content_;
  const CncReply reply = c.attempt(*this, [&c] {
    if (c.config.refused_connections > 0) {
      --c.config.refused_connections;
      return CncReply::refused;
    }
    c.text.erase(c.text.rfind('\n') + 1);  // npos + 1 is the beginning
    return CncReply::done;
  });
  if (reply == CncReply::reset) c.in_reset = false;  // it has been said
  return reply;
}

CncReply SimulatedCnc::send(std::string_view text, std::size_t& taken) {
  Content& c = *content_;
  taken = 0;
  std::size_t got = 0;
  const CncReply reply = c.attempt(*this, [&] {
    if (!c.state.on) return CncReply::refused;
    if (c.chance(c.config.busy) || c.text.size() + text.size() > kBuffer) return CncReply::busy;
    got = text.size();
    if (got > 1 && c.chance(c.config.in_part)) got = 1 + c.random() % (got - 1);
    c.text += text.substr(0, got);
    return CncReply::done;
  });
  if (reply == CncReply::done) taken = got;
  return reply;
}

CncReply SimulatedCnc::status(CncStatus& status) {
  Content& c = *content_;
  CncStatus seen;
  const CncReply reply = c.attempt(*this, [&] {
    seen = true_status();
    return CncReply::done;
  });
  if (reply == CncReply::done) status = seen;
  return reply;
}

CncReply SimulatedCnc::hold_feed(bool hold) {
  Content& c = *content_;
  return c.attempt(*this, [&c, hold] {
    if (hold) {
      ++c.truth.holds;
      if (!c.state.feed_held) c.truth.first_hold_ns = c.now;
    }
    c.state.feed_held = hold;
    return CncReply::done;
  });
}

CncReply SimulatedCnc::set_feed_override(double factor) {
  Content& c = *content_;
  return c.attempt(*this, [&c, factor] {
    c.state.feed_override = factor;
    return CncReply::done;
  });
}

CncReply SimulatedCnc::set_spindle_override(double factor) {
  Content& c = *content_;
  return c.attempt(*this, [&c, factor] {
    c.spindle_override = factor;
    return CncReply::done;
  });
}

CncReply SimulatedCnc::overrides(CncOverrides& overrides) {
  Content& c = *content_;
  CncOverrides seen;
  const CncReply reply = c.attempt(*this, [&] {
    seen = {c.state.feed_override, c.spindle_override};
    return CncReply::done;
  });
  if (reply == CncReply::done) overrides = seen;
  return reply;
}

Nanoseconds SimulatedCnc::now_ns() const {
  return content_->config.real_time ? CncLink::now_ns() : content_->now;
}

void SimulatedCnc::wait(double seconds) { content_->pass(*this, seconds); }

void SimulatedCnc::press_reset() {
  content_->stop_dead();
  content_->in_reset = true;
}
void SimulatedCnc::press_hold(bool hold) { content_->state.feed_held = hold; }
void SimulatedCnc::turn_overrides(double feed, double spindle) {
  content_->state.feed_override = feed;
  content_->spindle_override = spindle;
}
void SimulatedCnc::switch_on(bool on) {
  content_->state.on = on;
  if (!on) content_->stop_dead();
}
const SimulatedCncTruth& SimulatedCnc::truth() const { return content_->truth; }
CncStatus SimulatedCnc::true_status() const {
  CncStatus status = content_->state;
  status.moving = status.moving || content_->text.find('\n') != std::string::npos;
  return status;
}

}  // namespace servosense
