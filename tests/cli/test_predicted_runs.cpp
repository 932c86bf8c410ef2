// Random programs are predicted and their runs watched: sound ones with stock within its tolerance,
// harder and softer material, overrides, feed hold, pauses and a start in the middle; wrong ones.
// Beside it what a shop has without a prediction: a fixed limit at the highest torque that sound
// runs of the program reached, and a band that two sound runs taught. The figures are those of
// docs/torque-band.md.
#include <algorithm>
#include <array>
#include <cstdio>
#include <random>
#include <string>
#include <utility>

#include "check.hpp"
#include "predicted_runs.hpp"
#include "program.hpp"

namespace {

using namespace program_test;
using namespace predicted_runs;

constexpr double kStockTolerance_mm = 0.2;

struct Found {
  const char* what;
  int runs = 0, predicted = 0, taught = 0, limit = 0;
};
enum Kind { sound, growing, missing, worn, high, aside, less_worn, less_high, less_aside };
constexpr std::array kWrong = {growing, missing,   worn,      high,
                               aside,   less_worn, less_high, less_aside};
std::array<Found, 1 + kWrong.size()> all = {{{"sound"},
                                             {"growing depth, to 1.6 to 2.2 times"},
                                             {"no tool"},
                                             {"worn tool, 1.3 to 1.6 times the torque"},
                                             {"stock 1 to 2 mm too high"},
                                             {"stock 10 to 20 mm aside"},
                                             {"worn tool, 1.15 to 1.3 times the torque"},
                                             {"stock 0.5 to 1 mm too high"},
                                             {"stock 3 to 10 mm aside"}}};
/// The same fault in the runs that teach and in the one that is watched.
Found taught_wrong = {"worn tool or high stock, in what teaches too"};

class Part {
 public:
  explicit Part(unsigned seed) : random_(seed) {
    for (int pair = 0; pair < 3; ++pair) {
      const double depth = within(1.5, 5);
      passes_.push_back({depth, 0, within(500, 1200)});
      passes_.push_back({depth, within(1.5, 8), within(500, 1500)});
    }
  }
  double within(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random_);
  }
  std::size_t any_pass() {
    return std::uniform_int_distribution<std::size_t>(0, passes_.size() - 1)(random_);
  }
  /// Material and stock within what is sound.
  Run plain() {
    Run run;
    run.seed = static_cast<unsigned>(random_());
    run.torque = within(0.92, 1.08);
    run.higher = within(-kStockTolerance_mm, kStockTolerance_mm);
    run.aside = within(-kStockTolerance_mm, kStockTolerance_mm);
    return run;
  }
  Run of(Kind kind) {
    Run run = plain();
    if (kind == sound) {
      if (within(0, 1) < 0.5) run.slower_from = within(1, 30), run.slower = within(0.6, 1.2);
      if (within(0, 1) < 0.4) run.hold = true, run.holds = any_pass();
      if (within(0, 1) < 0.3) run.pause_behind = within(0, 5);
      if (within(0, 1) < 0.3) run.first = any_pass();
    }
    if (kind == growing) run.growth = within(0.6, 1.2), run.grows = any_pass();
    run.no_tool = kind == missing;
    if (kind == worn) run.torque *= within(1.3, 1.6);
    if (kind == high) run.higher += within(1, 2);
    if (kind == less_worn) run.torque *= within(1.15, 1.3);
    if (kind == less_high) run.higher += within(0.5, 1);
    const double side = within(0, 1) < 0.5 ? -1 : 1;
    if (kind == aside) run.aside += side * within(10, 20);
    if (kind == less_aside) run.aside += side * within(3, 10);
    return run;
  }
  [[nodiscard]] const Passes& passes() const { return passes_; }

 private:
  std::mt19937 random_;
  Passes passes_;
};

bool alarms(const char* machine) {
  const Outcome o = run(std::string("monitor --machine ") + machine +
                        " --trace part.csv --quiet --fail-on-alarm");
  that(o.status == 0 || o.status == 1, o, "is watched", __LINE__);
  return o.status == 1;
}

void teach(const Passes& passes, const Run& one, const Run& two, const char* band) {
  record("one.csv", passes, one);
  record("two.csv", passes, two);
  const Outcome o = run(std::string("identify torque-band --machine law.ini --quiet --out ") +
                        band + " one.csv two.csv");
  that(o.status == 0, o, "two runs teach", __LINE__);
}

void part(unsigned seed, int sound_runs) {
  Part of(seed);
  put("part.ngc", program_text(of.passes()));
  const Outcome o =
      run(std::string("program predict part.ngc --machine law.ini --stock-tolerance 0.0002 "
                      "--quiet --out steps.csv ") +
          kStock);
  that(o.status == 0, o, "is predicted", __LINE__);
  teach(of.passes(), of.plain(), of.plain(), "band.csv");
  double limit_Nm = 0;
  const auto watch = [&](Kind kind) {
    Found& found = all[kind];
    const double highest = record("part.csv", of.passes(), of.of(kind));
    ++found.runs;
    const bool predicted = alarms("predicted.ini"), taught = alarms("taught.ini");
    found.predicted += predicted, found.taught += taught;
    if (kind == sound) {
      limit_Nm = std::max(limit_Nm, highest);
      if (predicted) std::printf("  seed %u, sound run %d alarms\n", seed, found.runs);
    } else {
      found.limit += highest > limit_Nm;
    }
  };
  for (int i = 0; i < sound_runs; ++i) watch(sound);
  for (const Kind kind : kWrong) watch(kind);
  const Run fault = of.of(of.within(0, 1) < 0.5 ? worn : high);
  const auto again = [&] {
    Run other = of.plain();
    other.torque = fault.torque, other.higher = fault.higher;
    return other;
  };
  teach(of.passes(), again(), again(), "wrong.csv");
  record("part.csv", of.passes(), again());
  ++taught_wrong.runs;
  taught_wrong.predicted += alarms("predicted.ini");
  taught_wrong.taught += alarms("taught_wrong.ini");
}

void print(const Found& f) {
  std::printf("  %-48s of %3d: predicted %3d, taught %3d", f.what, f.runs, f.predicted, f.taught);
  if (&f != &taught_wrong) std::printf(", fixed limit %3d", f.limit);
  std::printf("\n");
}

}  // namespace

// `--nightly`: 200 sound runs, of 40 programs.
int main(int argc, char** argv) {
  const bool nightly = check::nightly(argc, argv);
  return in_own_folder("predicted_runs", [&] {
    put("law.ini", std::string(kMachine) + kLaw);
    for (const auto& [machine, reference] :
         {std::pair{"predicted.ini", "steps.csv"}, std::pair{"taught.ini", "band.csv"},
          std::pair{"taught_wrong.ini", "wrong.csv"}})
      put(machine,
          std::string(kMachine) + kLaw + "[monitor.torque-band]\nreference = " + reference + "\n");
    const unsigned programs = nightly ? 40 : 1, from = nightly ? 961001 : 1;
    for (unsigned seed = from; seed < from + programs; ++seed) part(seed, nightly ? 5 : 2);
    for (const Found& f : all) print(f);
    print(taught_wrong);
    CHECK(all[sound].predicted == 0);
    CHECK(all[missing].predicted == all[missing].runs);
    for (const Kind kind : {growing, worn, high, aside})
      CHECK(10 * all[kind].predicted >= 9 * all[kind].runs);
    CHECK(taught_wrong.predicted == taught_wrong.runs);
    // What the others miss: a fault that was there when they learned, and whatever stays below the
    // highest torque.
    CHECK(taught_wrong.taught == 0);
    CHECK(all[missing].limit == 0);
    if (!nightly) return;
    CHECK(2 * all[growing].limit < all[growing].runs);
    CHECK(20 * all[sound].taught >= all[sound].runs);
  });
}
