// Overrides to a CNC: the latest gets through, rounded towards 1; an operator who moves one wins;
// what was changed is given back.
#include <cmath>
#include <cstdint>
#include <random>

#include "check.hpp"
#include "servosense/hal/override_request.hpp"
#include "servosense/hal/simulated_cnc.hpp"
#include "servosense/hal/stop_request.hpp"

using namespace servosense;

namespace {

/// As the thread of a StopRequest does, in simulated time.
void serve(OverrideRequest& request, SimulatedCnc& cnc, double for_s) {
  const Nanoseconds end = cnc.now_ns() + nanoseconds_from(for_s);
  while (cnc.now_ns() < end) {
    const auto wait_s = request.turn();
    if (!wait_s) (void)cnc.connect();
    cnc.wait(wait_s.value_or(0.05));
  }
}

CncOverrides of(SimulatedCnc& cnc) {
  CncOverrides now;
  while (cnc.overrides(now) != CncReply::done) (void)cnc.connect();
  return now;
}

void the_latest_gets_through() {
  SimulatedCnc cnc;
  cnc.turn_overrides(0.9, 1.1);  // what the operator had
  OverrideRequest request(cnc);
  serve(request, cnc, 0.5);
  CHECK(request.health().commands == 0 && of(cnc).feed == 0.9 && of(cnc).spindle == 1.1);
  for (int i = 0; i <= 100; ++i) {
    request.set(1 - 0.003 * i, 1 - 0.005 * i);
    serve(request, cnc, 0.01);
  }
  serve(request, cnc, 0.3);
  // 0.45 and 0.77 of the operator's 90 and 110 %.
  CHECK_NEAR(of(cnc).feed, 0.45, 1e-12);
  CHECK_NEAR(of(cnc).spindle, 0.77, 1e-12);
  CHECK_NEAR(request.health().speed, 0.7, 1e-12);
  CHECK(request.health().takeovers == 0 && !request.taken_over());
  // Whole percents, none beyond what was asked for.
  std::mt19937 random(5);
  for (int i = 0; i < 200; ++i) {
    const double speed = 0.5 + static_cast<double>(random()) / 4294967296.0;
    request.set(speed, 1);
    serve(request, cnc, 0.25);
    const double is = of(cnc).spindle / 1.1;
    CHECK(speed < 1 ? is >= speed - 1e-9 && is <= 1 + 1e-9 : is <= speed + 1e-9 && is >= 1 - 1e-9);
    CHECK(std::abs(is - speed) < 0.016);
  }
  CHECK(request.give_back());
  CHECK_NEAR(of(cnc).spindle, 1.1, 1e-12);
  CHECK_NEAR(of(cnc).feed, 0.9, 1e-12);
}

// A tenth of the requests and replies is lost: the operator is not blamed for it.
void losses() {
  for (unsigned seed = 1; seed <= 40; ++seed) {
    SimulatedCncConfig config;
    config.seed = seed;
    config.lost_request = config.lost_reply = 0.1;
    SimulatedCnc cnc(config);
    OverrideRequest request(cnc);
    for (const double ratio : {0.8, 0.6, 1.2, 1.0}) {
      request.set(ratio, ratio);
      serve(request, cnc, 3);
      CHECK_NEAR(of(cnc).spindle, ratio, 1e-12);
      CHECK_NEAR(of(cnc).feed, ratio, 1e-12);
    }
    check::that(request.health().takeovers == 0, std::to_string(seed).c_str(), __FILE__, __LINE__);
  }
}

void the_operator_wins() {
  SimulatedCnc cnc;
  OverrideRequest request(cnc);
  request.set(0.8, 0.8);
  serve(request, cnc, 1);
  cnc.turn_overrides(0.8, 0.95);  // the spindle alone
  serve(request, cnc, 0.5);
  CHECK(request.taken_over() && !request.taken_over() && request.health().takeovers == 1);
  CHECK_NEAR(of(cnc).spindle, 0.95, 1e-12);
  request.set(0.7, 0.7);  // not yet heard of it
  serve(request, cnc, 1);
  CHECK_NEAR(of(cnc).spindle, 0.95, 1e-12);
  CHECK_NEAR(of(cnc).feed, 0.8, 1e-12);
  request.set(1, 1);  // heard
  serve(request, cnc, 1);
  CHECK_NEAR(of(cnc).spindle, 0.95, 1e-12);
  CHECK_NEAR(of(cnc).feed, 1, 1e-12);  // that one he has left alone
  request.set(0.8, 1);
  serve(request, cnc, 1);
  CHECK_NEAR(of(cnc).spindle, 0.76, 1e-12);
  CHECK(request.health().takeovers == 1);
}

// Beside a feed hold, on its thread and its link: the hold comes first.
void beside_a_feed_hold() {
  SimulatedCnc cnc;
  OverrideRequest overrides(cnc);
  StopRequest stop(cnc, {}, {}, [&] { return overrides.turn(); });
  const auto turns = [&](double for_s) {
    const Nanoseconds end = cnc.now_ns() + nanoseconds_from(for_s);
    while (cnc.now_ns() < end) {
      const double wait_s = stop.turn();
      cnc.wait(wait_s < 0 ? 0.01 : wait_s);
    }
  };
  turns(0.3);
  overrides.set(0.8, 0.8);
  stop.raise(cnc.now_ns());
  const std::uint64_t before = cnc.truth().tries;
  turns(0.002);
  CHECK(cnc.true_status().feed_held && cnc.truth().tries <= before + 2);
  turns(1);
  CHECK(stop.health().seen == 1);
  CHECK_NEAR(of(cnc).spindle, 0.8, 1e-12);  // goes on while it is held
}

// A link that cannot: nothing is commanded, nothing hangs.
void a_link_without() {
  class Plain final : public CncLink {
   public:
    std::string name_ = "plain";
    [[nodiscard]] const std::string& name() const override { return name_; }
    CncReply connect() override { return CncReply::done; }
    CncReply send(std::string_view, std::size_t&) override { return CncReply::done; }
    CncReply status(CncStatus&) override { return CncReply::done; }
    CncReply hold_feed(bool) override { return CncReply::done; }
    CncReply set_feed_override(double) override { return CncReply::done; }
  };
  Plain link;
  OverrideRequest request(link);
  request.set(0.5, 0.5);
  for (int i = 0; i < 10; ++i) CHECK(request.turn().value_or(0) > 0);
  CHECK(request.health().commands == 0 && request.give_back());
}

}  // namespace

int main() {
  the_latest_gets_through();
  losses();
  the_operator_wins();
  beside_a_feed_hold();
  a_link_without();
  return check::done();
}
