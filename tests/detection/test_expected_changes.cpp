// What the program could tell the chatter monitor: where the cut changes by itself (entries, exits,
// corners, depth), to within a tolerance in time. An alarm of such a stretch is passed over until
// it is over. Beside it the monitor as it is, which is not told; two generators, which share
// nothing.
//
//   expected_changes [--cases N] [--from SEED]    --nightly: 80
// Figures: docs/chatter.md.
#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "check.hpp"
#include "detection/random_cuts.hpp"
#include "detection/scores.hpp"
#include "detection/second_cuts.hpp"
#include "seed_range.hpp"

using namespace servosense;
using namespace detection;

namespace {

constexpr std::uint64_t kFirst = 842100;
constexpr double kTolerance_s = 0.1;             // of where a program is
constexpr double kStill = 0.2, kChatters = 0.3;  // feeds per tooth, as the study
constexpr double kMore = 4;
constexpr std::uint64_t kEnough = 20;  // cases that say something about the ways
constexpr std::size_t kNotHeard = ~std::size_t{0};

/// Every stretch longer by the tolerance on both sides.
std::vector<char> widened(const std::vector<char>& changing) {
  const auto wide = static_cast<std::size_t>(kTolerance_s / kPeriod_s);
  std::vector<char> out(changing.size(), 0);
  std::size_t until = 0;
  for (std::size_t i = 0; i < changing.size(); ++i) {
    if (i + wide < changing.size() && changing[i + wide] != 0)
      until = std::max(until, i + 2 * wide);
    if (i < wide && changing[i] != 0) until = std::max(until, i + wide);
    out[i] = i <= until && until > 0 ? 1 : 0;
  }
  return out;
}

constexpr std::array kWays = {"alone", "told, and silent there", "told, and less sensitive there"};
/// First sample with an alarm, as kWays.
using Heard = std::array<std::size_t, kWays.size()>;

template <typename Sample>
Heard hear(const HostStackConfig& config, const std::vector<char>& changing, Sample&& sample) {
  static auto stack = std::make_unique<HostStack>();
  stack->configure(config);
  const std::vector<char> expected = widened(changing);
  Heard h;
  h.fill(kNotHeard);
  for (std::size_t i = 0; i < changing.size(); ++i) {
    stack->process(sample(i));
    const auto& chatter = stack->chatter();
    if (chatter.state().state != MonitorState::alarm) continue;
    const auto& power = chatter.alarm(ChatterSign::power);
    const bool line = chatter.alarm(ChatterSign::line).state().state == MonitorState::alarm;
    const bool steady = expected[i] == 0;
    h[0] = std::min(h[0], i);
    if (steady) h[1] = std::min(h[1], i);
    if (steady || line || power.state().value >= kMore * power.threshold())
      h[2] = std::min(h[2], i);
  }
  return h;
}

struct Sum {
  std::size_t chattering = 0, stable = 0;
  Heard found{}, in_time{}, wrong{};  // counts
  std::array<std::vector<double>, kWays.size()> later_s;

  void add(bool chatters, const Heard& h, std::size_t feed) {
    ++(chatters ? chattering : stable);
    for (std::size_t k = 0; k < kWays.size(); ++k) {
      if (h[k] == kNotHeard) continue;
      if (!chatters) ++wrong[k];
      if (!chatters) continue;
      ++found[k];
      in_time[k] += h[k] <= feed ? 1 : 0;
      later_s[k].push_back(static_cast<double>(h[k] - h[0]) * kPeriod_s);
    }
  }
  void print(const char* what) const {
    std::printf("  %s: %zu cuts that chatter, %zu that do not\n", what, chattering, stable);
    for (std::size_t k = 0; k < kWays.size(); ++k) {
      const Interval i = wilson(static_cast<double>(wrong[k]), static_cast<double>(stable));
      std::printf(
          "    %-32s found %zu, before one feed per tooth %zu; false %zu (%.1f..%.1f %%); later by "
          "%.2f s in the mean, %.2f s for one in twenty\n",
          kWays[k], found[k], in_time[k], wrong[k], 100 * i.low, 100 * i.high, mean(later_s[k]),
          quantile(later_s[k], 0.95));
    }
  }
  static double mean(const std::vector<double>& values) {
    double sum = 0;
    for (const double v : values) sum += v;
    return values.empty() ? 0 : sum / static_cast<double>(values.size());
  }
};

std::size_t reaches(const std::vector<float>& vibration_m, double feed_m) {
  const auto it = std::find_if(vibration_m.begin(), vibration_m.end(),
                               [&](float v) { return static_cast<double>(v) >= feed_m; });
  return static_cast<std::size_t>(it - vibration_m.begin());
}

/// Cuts of the first generator, with all its features.
Sum random_cuts(std::uint64_t from, std::uint64_t cases) {
  Sum sum;
  for (std::uint64_t seed = from; seed < from + cases; ++seed)
    for (const bool chatters : {false, true}) {
      const Cut c = draw(seed, chatters ? detection::Event::chatter : detection::Event::none);
      const Record r = simulate(c);
      const double feed_m = c.milling().cut.feed_per_tooth_m;
      const double steady = static_cast<double>(r.steady_vibration_m) / feed_m;
      if (chatters ? steady < kChatters : steady > kStill) continue;
      Reporter<double> reporter(c, r, c.seed + 1);
      const Heard h =
          hear(learned_stack(c), r.changing, [&](std::size_t i) { return reporter.at(i); });
      sum.add(chatters, h, reaches(r.vibration_m, feed_m));
    }
  return sum;
}

/// Cuts of the second one, which grow: to what chatters, and to what does not.
Sum deeper_cuts(std::uint64_t from, std::uint64_t cases) {
  Sum sum;
  for (std::uint64_t seed = from; seed < from + cases; ++seed) {
    const second::Case c = second::draw(seed);
    const HostStackConfig config =
        second::plan_for(
            second::learned(c.machine, second::idle_run(c), static_cast<unsigned>(c.teeth())))
            .config;
    second::Draw d(seed + 17);
    for (const bool chatters : {false, true}) {
      second::Course course;
      course.cut_s = 1.7;
      course.grows_from_s = 0.3;
      course.grows_until_s = d.between(0.4, 1);
      course.grown = chatters ? d.between(1.3, 2.5) : d.between(0.6, 0.8);
      const second::Trace t = second::simulate(c, course);
      std::vector<char> changing;
      double most = 0;
      for (std::size_t i = 0; i < t.samples.size(); ++i) {
        const double in = static_cast<double>(i) * kPeriod_s - t.in_s;
        changing.push_back(in < 0 || (in > course.grows_from_s && in < course.grows_until_s));
        if (in > 0.1) most = std::max(most, static_cast<double>(t.vibration_m[i]));
      }
      const double feeds = most / c.feed_m;
      if (chatters ? feeds < kChatters : feeds > kStill) continue;
      sum.add(chatters, hear(config, changing, [&](std::size_t i) { return t.samples[i]; }),
              reaches(t.vibration_m, c.feed_m));
    }
  }
  return sum;
}

}  // namespace

int main(int argc, char** argv) {
  const auto [from, cases] =
      check::seed_range(argc, argv, {kFirst, check::nightly(argc, argv) ? 80U : 2U});
  const Sum first = random_cuts(from, cases);
  first.print("random cuts with features");
  const Sum second = deeper_cuts(from, cases);
  second.print("cuts that deepen, second generator");
  CHECK(first.chattering + second.chattering > 0 && first.stable + second.stable > 0);
  if (cases < kEnough) return check::done();
  // Why the monitor is not told: chatter begins where the cut changes.
  const auto both = [&](auto of, std::size_t way) { return (first.*of)[way] + (second.*of)[way]; };
  CHECK(both(&Sum::found, 0) > both(&Sum::found, 1));
  CHECK(both(&Sum::in_time, 0) > 2 * both(&Sum::in_time, 1));
  CHECK(both(&Sum::in_time, 0) > both(&Sum::in_time, 2));
  return check::done();
}
