// What the torque band says of the cause of an alarm: runs of random programs of six cuts, sound
// and wrong ones, and which cause is named by the first alarm and by the last. The table is that of
// docs/torque-band.md.
//
//   torque_cause                 20 programs
//   torque_cause --nightly       200
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <random>
#include <vector>

#include "check.hpp"
#include "seed_range.hpp"
#include "servosense/monitors/torque_band.hpp"

namespace {

using namespace servosense;

constexpr double kPoint_s = 0.02, kSample_s = 1e-3, kSpeed_rad_s = 200;
constexpr double kPass_s = 5, kPeriod_s = 6.5, kRamp_s = 0.5, kStarts_s = 1.2;

struct Cut {
  double depth_mm = 0, Nm_per_mm = 0;
  [[nodiscard]] double torque() const { return depth_mm * Nm_per_mm; }
};
using Cuts = std::vector<Cut>;

/// Share of a cut that is in at a time of its section: in, along, out.
double share(double t) {
  const double in = (t - kStarts_s) / kRamp_s, out = (kPass_s - t) / kRamp_s;
  return std::clamp(std::min(in, out), 0.0, 1.0);
}

enum Kind { sound, missing, everywhere, high, one_cut, lost, early, late, kKinds };
constexpr std::array kNames = {"sound",
                               "no tool",
                               "worn tool, 1.3 to 1.6 times the torque",
                               "stock 1 to 2 mm too high",
                               "one cut of 1.5 to 2 times its depth, the third or later",
                               "tool lost in the third cut or later",
                               "stock begins 0.5 to 0.9 s early",
                               "stock begins 1.4 to 2 s late"};
// What an alarm says: one explanation, or what cannot be told apart.
constexpr std::array kCauseNames = {"nothing",
                                    "never cut",
                                    "not cut",
                                    "cuts air",
                                    "teeth",
                                    "more here",
                                    "more in every cut",
                                    "more, not told which",
                                    "less here",
                                    "less in every cut",
                                    "less, not told which"};
constexpr std::size_t kCauses = kCauseNames.size();
std::size_t said(TorqueCause cause) {
  const auto kind = static_cast<std::size_t>(cause.kind());
  if (cause.kind() < TorqueCause::Kind::more) return kind;
  const std::size_t first = cause.kind() == TorqueCause::Kind::more ? 5 : 8;
  return first + (cause.is(TorqueExplanation::here)    ? 0U
                  : cause.is(TorqueExplanation::every) ? 1U
                                                       : 2U);
}
struct Table {
  int runs = 0, silent = 0;
  std::array<int, kCauses> first{}, last{};
};
std::array<Table, kKinds> tables;

void run(unsigned seed, Kind kind) {
  std::mt19937 random(seed);
  const auto within = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  Cuts cuts;
  for (int i = 0; i < 6; ++i) cuts.push_back({within(1.5, 5), within(1, 3)});
  double highest = 0;
  for (const Cut& c : cuts) highest = std::max(highest, c.torque());

  std::vector<TorqueBandPoint<double>> points;
  std::vector<TorqueBandSection<double>> sections;
  const auto expected = [&](double t) {
    const double clipped = std::clamp(t, 0.0, 6 * kPeriod_s - 1e-9);
    const auto i = static_cast<std::size_t>(clipped / kPeriod_s);
    return cuts[i].torque() * share(clipped - static_cast<double>(i) * kPeriod_s);
  };
  for (int i = 0; i * kPoint_s < 6 * kPeriod_s; ++i) {
    const double t = i * kPoint_s;
    TorqueBandPoint<double> p{expected(t), 1e9, -1e9, 0};
    for (int k = -15; k <= 15; ++k) {
      const double e = expected(t + k * kPoint_s);
      p.lower_Nm = std::min(p.lower_Nm, 0.8 * e - 0.03 * highest);
      p.upper_Nm = std::max(p.upper_Nm, 1.2 * e + 0.03 * highest);
    }
    points.push_back(p);
  }
  for (int i = 0; i < 6; ++i) {
    TorqueBandSection<double> s;
    s.first = static_cast<std::uint32_t>(std::lround(i * kPeriod_s / kPoint_s));
    s.block = 10 + i;
    s.speed_rad_s = kSpeed_rad_s;
    sections.push_back(s);
  }

  TorqueBandConfig c;
  c.spacing = kPoint_s;
  c.step = 0.05;
  c.shift_step = 0.04;
  c.max_shift = 1;
  c.sample_period_s = kSample_s;
  c.shifts_per_sample = 8;
  TorqueBandMonitor<double> band;
  CHECK(TorqueBandMonitor<double>::validate(c).ok());
  band.configure(c);
  band.set_reference(TorqueBandView<double>{points, sections});
  band.start();

  const double material = within(0.92, 1.08) * (kind == everywhere ? within(1.3, 1.6) : 1);
  const double higher = within(-0.1, 0.1) + (kind == high ? within(1, 2) : 0);
  const double along_s = within(-0.05, 0.05) + (kind == early  ? -within(0.5, 0.9)
                                                : kind == late ? within(1.4, 2)
                                                               : 0);
  const auto at = static_cast<std::size_t>(within(2, 6));
  const double deeper = kind == one_cut ? within(1.5, 2) : 1;
  std::normal_distribution<double> noise(0, 0.02 * highest);
  Table& table = tables[kind];
  ++table.runs;
  std::size_t alarms = 0, first = 0, last = 0;
  auto before = MonitorState::idle;
  double angle = 0;
  for (int n = 0; n * kSample_s < 6 * kPeriod_s; ++n) {
    const double t = n * kSample_s;
    const auto i = static_cast<std::size_t>(t / kPeriod_s);
    const double in_s = t - static_cast<double>(i) * kPeriod_s;
    // The stock's beginning moves, its end stays.
    const double in = std::min(share(in_s), share(std::min(in_s - along_s, kPass_s - kRamp_s)));
    const double early_in = std::max(share(in_s), share(std::min(in_s - along_s, 3.0)));
    const double cut = along_s < 0 ? (in_s < 3 ? early_in : share(in_s)) : in;
    const double depth = cuts[i].depth_mm * (i == at ? deeper : 1) + higher;
    const bool gone = kind == missing || (kind == lost && (i > at || (i == at && in_s > 3)));
    angle += kSpeed_rad_s * kSample_s;
    const double torque = gone ? 0
                               : material * depth * cuts[i].Nm_per_mm * cut *
                                     (1 + 0.3 * std::sin(3 * angle) + 0.1 * std::sin(angle));
    const auto now = band.process(torque + noise(random), kSpeed_rad_s * kSample_s, kSample_s, 1,
                                  Quality::good, static_cast<std::int32_t>(10 + i));
    if (now == MonitorState::alarm && before != MonitorState::alarm) {
      last = said(band.core().cause);
      if (alarms++ == 0) first = last;
    }
    before = now;
  }
  if (alarms == 0) {
    ++table.silent;
    return;
  }
  ++table.first[first];
  ++table.last[last];
}

void print(const Table& t, const char* name) {
  std::printf("  %-56s of %3d: silent %3d", name, t.runs, t.silent);
  for (const auto* which : {&t.first, &t.last}) {
    std::printf(which == &t.first ? "; first" : "; last");
    for (std::size_t i = 0; i < kCauses; ++i)
      if ((*which)[i] > 0) std::printf(", %s %d", kCauseNames[i], (*which)[i]);
  }
  std::printf("\n");
}

}  // namespace

int main(int argc, char** argv) {
  const bool nightly = check::nightly(argc, argv);
  const check::SeedRange seeds = check::seed_range(
      argc, argv, nightly ? check::SeedRange{972001, 200} : check::SeedRange{1, 20});
  for (auto seed = static_cast<unsigned>(seeds.from); seed < seeds.from + seeds.cases; ++seed)
    for (int kind = 0; kind < kKinds; ++kind)
      run(100 * seed + static_cast<unsigned>(kind), static_cast<Kind>(kind));
  for (std::size_t i = 0; i < kKinds; ++i) print(tables[i], kNames[i]);
  using Why = TorqueCause::Kind;
  const auto named = [](const std::array<int, kCauses>& of, TorqueCause cause) {
    return of[said(cause)];
  };
  const auto most = [&](Kind kind, int n) {
    return 10 * n >= 9 * (tables[kind].runs - tables[kind].silent);
  };
  CHECK(tables[sound].silent == tables[sound].runs);
  CHECK(named(tables[missing].first, Why::never_cut) == tables[missing].runs);
  CHECK(most(lost, named(tables[lost].first, Why::not_cut)));
  CHECK(most(one_cut, named(tables[one_cut].first, TorqueCause(Why::more, 1))));
  // An alarm whose last steps the tolerance in time holds again names nothing, and nothing wrong.
  const int cuts_air = named(tables[early].first, Why::cuts_air);
  CHECK(most(early, cuts_air + named(tables[early].first, Why::unknown)));
  CHECK(2 * cuts_air >= tables[early].runs - tables[early].silent);
  CHECK(most(late, named(tables[late].first, Why::never_cut)));
  // In the first cut nothing can be told; the cuts behind it tell.
  CHECK(named(tables[everywhere].first, TorqueCause(Why::more, 1)) == 0);
  CHECK(most(everywhere, named(tables[everywhere].last, TorqueCause(Why::more, 2))));
  return check::done();
}
