// How well chatter could be told from the signals that a controller gives, by somebody who knows
// more than any monitor: the torque as it would be without vibration, drives and cut simulated once
// more with a structure ten thousand times as stiff (of a stable cut: its own, without noise). What
// is left is chatter and the noise of counter and current, told apart by the strongest line of its
// spectrum over eight revolutions, in the cut, above the mean noise of the idling run:
//
//   frequency told     at the line where the chatter of this cut is strongest, beforehand; of a
//                      stable cut at its first mode
//   any frequency      the strongest of 150 to 1600 Hz
//
//   chatter_bound [--cases N] [--from SEED]    --nightly: 300 of each kind
// Figures: docs/detection.md.
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include "check.hpp"
#include "detection/random_cuts.hpp"
#include "detection/scores.hpp"
#include "detection/without_vibration.hpp"
#include "servosense/dsp/short_time_fourier.hpp"

using namespace servosense;
using namespace detection;
using detection::Event;

namespace {

constexpr std::uint64_t kFirstSeed = 100000;
constexpr double kStill = 0.2, kChatters = 0.3;         // as the study
constexpr double kLowest_hz = 150, kHighest_hz = 1600;  // of modes, less and more

std::vector<double> difference(const std::vector<double>& a, const std::vector<double>& b,
                               double from_s, double to_s) {
  std::vector<double> d;
  const auto at = [](double t_s) {
    return static_cast<std::size_t>(std::max(0.0, t_s) / kPeriod_s);
  };
  for (std::size_t i = at(from_s); i < std::min({a.size(), b.size(), at(to_s)}); ++i)
    d.push_back(a[i] - b[i]);
  return d;
}

struct Lines {
  Spectrogram s;
  std::size_t lowest, highest;

  // Strongest of the band at any time, and which.
  [[nodiscard]] double most(std::size_t* where = nullptr) const {
    double most = 0;
    for (std::size_t k = lowest; k <= highest; ++k)
      if (const double p = at(k); p > most) {
        most = p;
        if (where != nullptr) *where = k;
      }
    return most;
  }
  [[nodiscard]] double at(std::size_t k) const {
    double most = 0;
    for (std::size_t f = 0; f < s.frames(); ++f) most = std::max(most, s.at(f, k));
    return most;
  }
  [[nodiscard]] double mean() const {
    double sum = 0;
    for (std::size_t f = 0; f < s.frames(); ++f)
      for (std::size_t k = lowest; k <= highest; ++k) sum += s.at(f, k);
    return sum / static_cast<double>(s.frames() * (highest - lowest + 1));
  }
};

std::size_t window_of_eight(const Cut& c) {
  return static_cast<std::size_t>(std::lround(8 * c.turn_s() / kPeriod_s));
}

Lines lines(const Cut& c, const std::vector<double>& torque_Nm) {
  ShortTimeFourierConfig config;
  config.window = window_of_eight(c);
  config.hop = config.window / 8;
  config.lines = std::bit_ceil(config.window);
  Lines l{good(short_time_fourier(torque_Nm, 1 / kPeriod_s, config), "spectrogram"), 0, 0};
  const auto line = [&](double hz) {
    return static_cast<std::size_t>(std::lround(hz / l.s.frequency_hz[1]));
  };
  l.lowest = line(kLowest_hz);
  l.highest = line(kHighest_hz);
  return l;
}

}  // namespace

int main(int argc, char** argv) {
  std::size_t cases = 8;
  std::uint64_t from = kFirstSeed;
  for (int i = 1; i < argc; ++i) {
    const std::string option = argv[i];
    const char* value = i + 1 < argc ? argv[i + 1] : "0";
    if (option == "--nightly") cases = 300;
    if (option == "--cases") cases = std::strtoul(value, nullptr, 10);
    if (option == "--from") from = std::strtoul(value, nullptr, 10);
  }
  Scores told, any;
  for (std::size_t n = 0; n < cases; ++n)
    for (const Event event : {Event::none, Event::chatter}) {
      const bool chatters = event == Event::chatter;
      const Cut c = draw(from + n, event);
      const Record r = simulate(c);
      const double feeds =
          static_cast<double>(r.steady_vibration_m) / c.milling().cut.feed_per_tooth_m;
      if (chatters ? feeds < kChatters : feeds > kStill) continue;
      const Record idle = idle_run(c);
      const HostStackConfig config =
          good(plan_stack(learn(c, idle), signals()), c.text.c_str()).config;
      const double contact_s = r.schedule.contact_s, stop_s = r.schedule.stop_s;
      const auto torque = heard(c, r, config), exact = heard_exactly(c, r, config);
      const auto forced = chatters ? heard_exactly(c, simulate(rigid(c)), config) : exact;
      const auto quiet = difference(heard(c, idle, config), heard_exactly(c, idle, config), 0.05,
                                    static_cast<double>(idle.size()) * kPeriod_s);
      const double level = lines(c, quiet).mean();
      // What the controller reports differs by noise alone. It has no mean: five standard errors of
      // one value in eight, a current at 1 kHz.
      double sum = 0, squares = 0;
      for (const double d : quiet) sum += d, squares += d * d;
      CHECK(std::abs(sum) < 5 * std::sqrt(8 * squares));

      const auto rest = difference(torque, forced, contact_s, stop_s);
      if (rest.size() < window_of_eight(c)) continue;  // the tool was lost
      const Lines left = lines(c, rest);
      std::size_t line = 0;
      if (chatters)
        (void)lines(c, difference(exact, forced, contact_s, stop_s)).most(&line);
      else
        line = static_cast<std::size_t>(
            std::lround(c.milling().structure.x[0].natural_frequency_hz / left.s.frequency_hz[1]));
      (chatters ? told.with : told.without).push_back(left.at(line) / level);
      (chatters ? any.with : any.without).push_back(left.most() / level);
      CHECK(left.most() >= left.at(std::clamp(line, left.lowest, left.highest)));
    }
  std::printf("  seeds %llu to %llu\n", static_cast<unsigned long long>(from),
              static_cast<unsigned long long>(from + cases - 1));
  const auto print = [](const char* name, const Scores& s) {
    std::printf("  %-32s AUC %.4f +- %.4f; %.1f %% of %zu found where 1 %% of %zu alarm falsely\n",
                name, s.auc(), 1.96 * s.auc_error(), 100 * s.found_at(0.01), s.with.size(),
                s.without.size());
  };
  print("forced part and frequency told", told);
  print("forced part told, any frequency", any);
  if (told.with.size() >= 5 && told.without.size() >= 5) {
    CHECK(told.auc() > 0.97);
    CHECK(any.auc() > 0.9);
  }
  return check::done();
}
