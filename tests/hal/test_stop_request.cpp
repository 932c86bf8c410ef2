// The feed hold on an alarm: once an event, repeated until it is acknowledged, never waited for by
// whoever raises it.
#include <chrono>
#include <cmath>
#include <mutex>
#include <random>
#include <thread>
#include <vector>

#include "check.hpp"
#include "count_allocations.hpp"
#include "servosense/hal/cnc_channel.hpp"
#include "servosense/hal/simulated_cnc.hpp"
#include "servosense/hal/stop_request.hpp"

using namespace servosense;

namespace {

constexpr Nanoseconds kSample = 125000;
constexpr double kFeed = 0.02;  // m/s

/// Turns of the request in simulated time until it has nothing to do, for at most a minute.
void serve(StopRequest& request, SimulatedCnc& cnc, double for_s) {
  const Nanoseconds end = cnc.now_ns() + nanoseconds_from(for_s);
  while (cnc.now_ns() < end) {
    const double wait_s = request.turn();
    cnc.wait(wait_s < 0 ? 0.01 : wait_s);
  }
}

void under_way(SimulatedCnc& cnc) {
  std::size_t taken = 0;
  CncReply reply = CncReply::no_answer;
  for (int n = 0; n < 100 && (reply != CncReply::done || taken < 30); ++n)
    reply = cnc.send("G1 G90 F[1200.000000] X[500.000000]\n", taken);
  cnc.wait(0.5);
}

// From the sample to the machine's standstill, in samples.
void stops_in_time() {
  SimulatedCnc cnc;
  under_way(cnc);
  CHECK_NEAR(cnc.truth().speed_m_s, kFeed, 1e-12);
  StopRequest request(cnc);
  serve(request, cnc, 0.01);  // connects
  const Nanoseconds arrival = cnc.now_ns();
  const double from_m = cnc.true_status().position_m[0];
  request.raise(arrival);
  CHECK(request.active());
  serve(request, cnc, 1);
  const StopHealth h = request.health();
  CHECK(h.raised == 1 && h.events == 1 && h.held == 1 && h.seen == 1 && h.tries == 1 && h.holding);
  // Half an answer's time, 1 ms, and a step of the simulation.
  const auto samples = (cnc.truth().first_hold_ns - arrival) / kSample;
  check::figure("samples until the feed hold acts, nothing lost", static_cast<double>(samples));
  CHECK(samples <= 9);
  CHECK(cnc.truth().speed_m_s == 0);
  // Way until the hold, and v^2 / 2a.
  CHECK_NEAR(cnc.true_status().position_m[0] - from_m,
             kFeed * seconds_from(cnc.truth().first_hold_ns - arrival) + kFeed * kFeed / 2, 6e-6);
  CHECK_BETWEEN(static_cast<double>(h.reaction.greatest_ns()), 2e6, 3e6);
}

// With losses: n of them cost n (time limit + pause) each, and that of the connections made anew.
void losses(unsigned runs) {
  Nanoseconds worst = 0, sum = 0;
  std::uint64_t most_tries = 0;
  for (unsigned seed = 1; seed <= runs; ++seed) {
    SimulatedCncConfig config;
    config.seed = seed;
    config.lost_request = 0.15;
    config.lost_reply = 0.15;
    SimulatedCnc cnc(config);
    under_way(cnc);
    StopRequestConfig timing;
    StopRequest request(cnc, timing);
    serve(request, cnc, 0.5);
    const std::uint64_t tries_before = cnc.truth().tries;
    const Nanoseconds arrival = cnc.now_ns();
    request.raise(arrival);
    while (request.health().held == 0 && cnc.now_ns() < arrival + 60 * kNanosecondsPerSecond) {
      const double wait_s = request.turn();
      cnc.wait(std::max(wait_s, 0.0));
    }
    const std::uint64_t tries = cnc.truth().tries - tries_before;
    const Nanoseconds took = cnc.truth().first_hold_ns - arrival;
    const double bound_s =
        static_cast<double>(tries) * (config.time_limit_s + timing.retry_s) + config.reply_s;
    const StopHealth h = request.health();
    const bool ok = h.events == 1 && h.held == 1 && h.given_up == 0 && cnc.truth().holds >= 1 &&
                    took > 0 && seconds_from(took) <= bound_s && cnc.true_status().feed_held;
    if (!ok) check::fail(__FILE__, __LINE__) << "seed " << seed << ": " << took << " ns\n";
    ++check::checks;
    worst = std::max(worst, took);
    sum += took;
    most_tries = std::max(most_tries, h.tries);
  }
  check::figure("samples until it acts, 28 % of the tries lost: mean",
                static_cast<double>(sum / runs / kSample));
  check::figure("  worst", static_cast<double>(worst / kSample));
  check::figure("  most feed holds sent for one alarm", static_cast<double>(most_tries));
  CHECK(most_tries > 2);
}

void once_an_event() {
  SimulatedCnc cnc;
  under_way(cnc);
  StopRequest request(cnc);
  serve(request, cnc, 0.1);
  CHECK(cnc.truth().holds == 0 && !request.active());
  for (int n = 0; n < 50; ++n) {
    request.raise(cnc.now_ns());
    serve(request, cnc, 0.1);
  }
  CHECK(cnc.truth().holds == 1);
  StopHealth h = request.health();
  CHECK(h.raised == 50 && h.events == 1 && h.held == 1 && h.joined == 49 && h.released == 0);
  // The operator goes on: nobody stops him for the old alarm.
  cnc.press_hold(false);
  serve(request, cnc, 1);
  CHECK(cnc.truth().holds == 1 && cnc.truth().speed_m_s > 0 && !request.active());
  request.raise(cnc.now_ns());
  serve(request, cnc, 1);
  h = request.health();
  CHECK(cnc.truth().holds == 2 && cnc.truth().speed_m_s == 0);
  CHECK(h.events == 2 && h.held == 2 && h.released == 1 && h.holding);
}

// A controller that acknowledges and does nothing is told again; a dead one is given up.
void no_effect_and_no_answer() {
  struct Stubborn final : CncLink {
    std::string title = "stubborn";
    int asked = 0;
    Nanoseconds now = 0;
    [[nodiscard]] const std::string& name() const override { return title; }
    CncReply connect() override { return CncReply::done; }
    CncReply send(std::string_view, std::size_t&) override { return CncReply::done; }
    CncReply status(CncStatus& status) override {
      status.on = status.moving = true;
      status.feed_held = asked >= 4;
      return CncReply::done;
    }
    CncReply hold_feed(bool) override {
      ++asked;
      now += 1000000;
      return CncReply::done;
    }
    CncReply set_feed_override(double) override { return CncReply::done; }
    [[nodiscard]] Nanoseconds now_ns() const override { return now; }
  };
  Stubborn cnc;
  StopRequest request(cnc);
  request.raise(0);
  for (int n = 0; n < 20; ++n) request.turn();
  const StopHealth h = request.health();
  CHECK(cnc.asked == 4 && h.tries == 4 && h.held == 1 && h.events == 1 && h.holding);
  CHECK(h.reaction.greatest_ns() == 1000000);

  SimulatedCncConfig deaf;
  deaf.lost_request = 1;
  SimulatedCnc dead(deaf);
  StopRequest unheard(dead);
  unheard.raise(dead.now_ns());
  serve(unheard, dead, 15);
  CHECK(unheard.health().given_up == 1 && unheard.health().held == 0 && !unheard.active());
  unheard.raise(dead.now_ns());
  serve(unheard, dead, 1);
  CHECK(unheard.health().events == 2);
}

// A controller that says yes and runs on, in each way there is: never counted as stopped, and said
// once, in time.
void acknowledged_and_running() {
  struct Runaway final : CncLink {
    std::string title = "runaway";
    Nanoseconds now = 0;
    bool says_held = false, says_idle = false, tells = true;
    bool stands = false;
    double at_m = 0;
    int asked = 0;
    [[nodiscard]] const std::string& name() const override { return title; }
    CncReply connect() override { return CncReply::done; }
    CncReply send(std::string_view, std::size_t&) override { return CncReply::done; }
    CncReply status(CncStatus& status) override {
      if (!tells) return CncReply::no_answer;
      status.on = true;
      status.feed_held = says_held;
      status.moving = !says_idle;
      if (!stands) at_m += 0.001;
      status.position_m[1] = at_m;
      return CncReply::done;
    }
    CncReply hold_feed(bool) override {
      ++asked;
      return CncReply::done;
    }
    CncReply set_feed_override(double) override { return CncReply::done; }
    [[nodiscard]] Nanoseconds now_ns() const override { return now; }
  };
  const auto serve_until = [](Runaway& cnc, StopRequest& request, double end_s) {
    while (seconds_from(cnc.now) < end_s)
      cnc.now += nanoseconds_from(std::max(request.turn(), 0.001));
  };
  struct Way {
    bool held, idle, tells;
    double in_time_s;  // by which it is said
    const char* what;
  };
  for (const Way& way :
       {Way{false, false, true, 0.55, "acknowledges the feed hold and keeps running"},
        Way{true, false, true, 2.1, "says that the feed is held, and its axes move"},
        Way{false, true, true, 2.1, "says that the feed is held, and its axes move"},
        Way{false, false, false, 0.55, "has acknowledged the feed hold and says no"}}) {
    Runaway cnc;
    cnc.says_held = way.held;
    cnc.says_idle = way.idle;
    cnc.tells = way.tells;
    std::vector<std::string> said;
    StopRequest request(cnc, {}, [&](const std::string& what) { said.push_back(what); });
    request.raise(0);
    serve_until(cnc, request, way.in_time_s);
    CHECK(said.size() == 1 && said[0].find(way.what) != std::string::npos);
    CHECK(request.health().held == 1 && request.health().seen == 0);
    serve_until(cnc, request, 12);
    const StopHealth h = request.health();
    CHECK(said.size() == 1 && h.overdue == 1 && h.seen == 0 && h.given_up == 1 && !h.holding);
    CHECK(cnc.asked > 2);
    // The next alarm is a new event, and this time it stands.
    cnc.says_held = cnc.tells = cnc.stands = true;
    request.raise(cnc.now);
    serve_until(cnc, request, 13);
    CHECK(request.health().events == 2 && request.health().seen == 1 && request.health().holding);
    CHECK(said.size() == 1);
  }
  // One that brakes for a second and then stands is no failure.
  Runaway brakes;
  brakes.says_held = true;
  bool complained = false;
  StopRequest request(brakes, {}, [&](const std::string&) { complained = true; });
  request.raise(0);
  serve_until(brakes, request, 1);
  brakes.stands = true;
  serve_until(brakes, request, 5);
  CHECK(!complained && request.health().seen == 1 && request.health().overdue == 0);
}

// The thread that raises never waits, whatever the controller does; and it takes no memory.
void never_waits() {
  struct Stuck final : CncLink {
    std::string title = "stuck";
    std::mutex door;
    std::atomic<int> entered{0};
    [[nodiscard]] const std::string& name() const override { return title; }
    CncReply connect() override { return CncReply::done; }
    CncReply send(std::string_view, std::size_t&) override { return CncReply::done; }
    CncReply status(CncStatus& status) override {
      status.on = status.feed_held = true;
      return CncReply::done;
    }
    CncReply hold_feed(bool) override {
      ++entered;
      const std::lock_guard lock(door);
      return CncReply::done;
    }
    CncReply set_feed_override(double) override { return CncReply::done; }
  };
  Stuck cnc;
  StopRequest request(cnc);
  cnc.door.lock();
  request.start();
  request.raise(cnc.now_ns());
  while (cnc.entered == 0) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  // It stands in the door. Were anything shared with it, this would never end.
  const unsigned long before = allocations;
  for (int n = 0; n < 100000; ++n) request.raise(cnc.now_ns());
  CHECK(allocations == before);
  CHECK(request.health().held == 0);
  cnc.door.unlock();
  while (request.health().joined == 0) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  request.stop();
  const StopHealth h = request.health();
  CHECK(cnc.entered == 1 && h.events == 1 && h.held == 1 && h.raised == 100001);
  // Of the others one was kept: they are the same alarm.
  CHECK(h.joined == 1);

  // What is raised at the last moment still gets through.
  for (int n = 0; n < 20; ++n) {
    SimulatedCncConfig config;
    config.real_time = true;
    SimulatedCnc other(config);
    StopRequest last(other);
    last.start();
    last.raise(other.now_ns());
    last.stop();
    CHECK(last.health().held == 1 && other.truth().holds == 1);
  }
}

}  // namespace

int main(int argc, char** argv) {
  const bool nightly = check::nightly(argc, argv);
  stops_in_time();
  losses(nightly ? 20000 : 500);
  once_an_event();
  no_effect_and_no_answer();
  acknowledged_and_running();
  never_waits();
  return check::done();
}
