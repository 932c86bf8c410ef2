// Alarm logic against hand-worked sequences and against a slow reading of its rules.
#include <limits>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "check.hpp"
#include "servosense/monitors/monitor.hpp"

namespace {

using namespace servosense;

AlarmLogicConfig config() {
  AlarmLogicConfig c;
  c.threshold = 100;
  c.warning_fraction = 0.75;
  c.release_fraction = 0.5;
  c.release_samples = 4;
  c.consecutive_samples = 3;
  c.patience_samples = 5;
  return c;
}

// a = armed, w = warning, A = alarm, i = idle, l = learning, f = signal fault.
char letter(MonitorState s) {
  constexpr char kLetters[] = {'i', 'l', 'a', 'w', 'A', 'f'};
  return kLetters[static_cast<std::size_t>(s)];
}

template <typename Real>
std::string run(AlarmLogic<Real>& logic, std::initializer_list<double> values,
                SignalState signal = SignalState::good) {
  std::string states;
  for (const double v : values) states += letter(logic.process(static_cast<Real>(v), signal));
  return states;
}

template <typename Real>
void by_hand() {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  AlarmLogic<Real> logic;
  CHECK_TEXT(run(logic, {200, 200, 200}), "iii");  // not configured: no threshold
  logic.configure(config());
  CHECK_TEXT(run(logic, {0, 100, 100, 99, 100, 100}), "aaawww");  // two do not fire
  logic.reset();
  CHECK_TEXT(run(logic, {100, 100, 100, 0, 0, 0, 0, 0}), "aaAAAAaa");
  logic.reset();
  // The release count starts anew whenever the value is back at the release level.
  CHECK_TEXT(run(logic, {80, 80, 80, 49, 49, 49, 50, 49, 49, 49, 49}), "aawwwwwwwwa");
  logic.reset();
  CHECK_TEXT(run(logic, {150, 150, 150, 150, 60, 150, 150, 150}), "aaAAAAAA");  // one alarm
  // An alarm outlasts five samples that say nothing, and goes on behind them.
  CHECK_TEXT(run(logic, {nan}), "A");
  CHECK_TEXT(run(logic, {0, 0, 0, 0}, SignalState::faulty), "AAAA");
  CHECK_TEXT(run(logic, {150}), "A");
  CHECK_TEXT(run(logic, {0, 0}, SignalState::faulty), "AA");
  CHECK_TEXT(run(logic, {0, 0, 0, 0}, SignalState::filling), "AAAl");
  CHECK_TEXT(run(logic, {150, 150}), "aa");                     // a fault ends the count as well
  CHECK_TEXT(run(logic, {0, 0}, SignalState::doubtful), "aa");  // doubt does not
  CHECK_TEXT(run(logic, {150}), "A");
  CHECK_TEXT(run(logic, {0}, SignalState::standstill), "i");
  CHECK_TEXT(run(logic, {150, 150}), "aa");
  CHECK_TEXT(run(logic, {std::numeric_limits<double>::infinity()}), "f");
  CHECK_TEXT(run(logic, {150, 150, 150}), "aaA");
  CHECK_TEXT(run(logic, {0, 0, 0, 0, 0, 0}, SignalState::faulty), "AAAAAf");
  CHECK_TEXT(run(logic, {500, 500, 500, 500}, SignalState::filling), "llll");
  CHECK_TEXT(run(logic, {500, 500, 500, 500}, SignalState::standstill), "iiii");
  CHECK_TEXT(run(logic, {500, 500, 500}), "aaA");
}

// The rules as they read, over the whole history, quadratic in its length.
void by_the_rules() {
  const unsigned seed = 17;
  std::mt19937 random(seed);
  const AlarmLogicConfig c = config();
  AlarmLogic<double> logic;
  logic.configure(c);
  std::vector<double> history;
  MonitorState expected = MonitorState::armed;
  unsigned away = 0;
  int faults = 0;
  auto last_all = [&](std::size_t n, auto condition) {
    if (history.size() < n) return false;
    for (std::size_t i = history.size() - n; i < history.size(); ++i)
      if (!condition(history[i])) return false;
    return true;
  };
  bool same = true;
  std::set<MonitorState> seen;
  double level = 50;
  for (int n = 0; n < 200'000; ++n) {
    if (random() % 6 == 0) level = static_cast<double>(random() % 130);
    if (random() % 400 == 0) faults = 1 + static_cast<int>(random() % 9);
    const bool fault = faults-- > 0;
    const double value = level + static_cast<double>(random() % 7);
    const MonitorState got = logic.process(value, fault ? SignalState::faulty : SignalState::good);
    if (fault) {
      history.clear();
      const bool raised = expected == MonitorState::alarm || expected == MonitorState::warning;
      if (!raised || ++away > 5) expected = MonitorState::signal_fault;
    } else {
      away = 0;
      history.push_back(value);
      if (expected == MonitorState::signal_fault) expected = MonitorState::armed;
      if (last_all(3, [](double v) { return v >= 100; }))
        expected = MonitorState::alarm;
      else if (expected == MonitorState::armed && last_all(3, [](double v) { return v >= 75; }))
        expected = MonitorState::warning;
      else if (last_all(4, [](double v) { return v < 50; }))
        expected = MonitorState::armed;
    }
    same = same && got == expected;
    seen.insert(got);
  }
  check::that(same, ("rules, seed " + std::to_string(seed)).c_str(), __FILE__, __LINE__);
  CHECK(seen.size() == 4);
}

void names() {
  std::set<std::string> names;
  for (int i = 0; i <= static_cast<int>(MonitorId::signal); ++i)
    CHECK(names.insert(name_of(static_cast<MonitorId>(i))).second);
  for (int i = 0; i <= static_cast<int>(MonitorState::signal_fault); ++i)
    CHECK(names.insert(name_of(static_cast<MonitorState>(i))).second);
  CHECK(names.count("collision") == 1 && names.count("signal-fault") == 1);
}

void refusals() {
  auto refused = [](auto change, const char* parameter) {
    AlarmLogicConfig c = config();
    change(c);
    const Status s = AlarmLogic<float>::validate(c);
    CHECK(!s.ok());
    CHECK_TEXT(s.parameter(), parameter);
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  CHECK(AlarmLogic<float>::validate(config()).ok());
  refused([&](auto& c) { c.threshold = nan; }, "threshold");
  refused([&](auto& c) { c.threshold = -1; }, "threshold");
  refused([&](auto& c) { c.warning_fraction = 1.1; }, "warning_fraction");
  refused([&](auto& c) { c.warning_fraction = 0; }, "warning_fraction");
  refused([&](auto& c) { c.release_fraction = 0.8; }, "release_fraction");
  refused([&](auto& c) { c.release_fraction = nan; }, "release_fraction");
  refused([&](auto& c) { c.release_samples = 0; }, "release_samples");
  refused([&](auto& c) { c.consecutive_samples = 0; }, "consecutive_samples");
}

}  // namespace

int main() {
  by_hand<float>();
  by_hand<double>();
  by_the_rules();
  names();
  refusals();
  return check::done();
}
