// servosense identify presliding: what it writes, what it prints, what it refuses; and that
// identify idle, which needs motion, points to it.
#include <cmath>
#include <string>

#include "check.hpp"
#include "cli/program.hpp"
#include "cli/pushed_drive.hpp"

namespace {

using namespace program_test;

void put(const std::string& name, const std::string& text) { std::ofstream(folder / name) << text; }

void tests() {
  put("pushed.csv", pushed::trace());
  put("known.ini", std::string(pushed::kMachine) + "coulomb_friction_Nm = 0.014\n");
  put("new.ini", pushed::kMachine);

  const Outcome idle = run("identify idle --machine new.ini --trace pushed.csv --out i.ini");
  that(contains(idle.err, "'servosense identify presliding'"), idle, "points to it", __LINE__);

  const Outcome o =
      run("identify presliding --machine known.ini --trace pushed.csv --out o.ini --json");
  that(o.status == 0, o, "identifies", __LINE__);
  const Json json(o.out);
  const auto within = [&](const char* key, double truth) {
    const std::string at = std::string("drives.0.") + key;
    const double error = json.number(at + ".standard_error");
    CHECK_NEAR(json.number(at + ".value"), truth, 2.6 * error);
    CHECK_BETWEEN(error, 0, 0.1 * truth);
  };
  within("stiffness_Nm_per_rad", pushed::kStiffness);
  within("breakaway_Nm", pushed::kBreakaway);
  CHECK_TEXT(json.text("drives.0.one_bristle"), "true");
  const double slope = json.number("drives.0.slope_Nm_per_rad.value");
  CHECK_NEAR(json.number("drives.0.friction_knee_rad"), 0.014 / slope, 1e-6 * 0.014 / slope);
  const std::string machine = content(folder / "o.ini");
  CHECK(contains(machine, "[effect.spindle.presliding-hysteresis]"));
  CHECK(contains(machine, "friction_knee_rad = "));
  // What was written is read by what watches, and found again.
  const Outcome again =
      run("identify presliding --machine o.ini --trace pushed.csv --out o2.ini --json");
  that(again.status == 0, again, "once more", __LINE__);
  CHECK_NEAR(Json(again.out).number("drives.0.slope_Nm_per_rad.value"), slope, 1e-9);

  // Without Coulomb friction there is nothing whose place the bristle could take.
  const Outcome first = run("identify presliding --machine new.ini --trace pushed.csv --out n.ini");
  that(first.status == 0 && contains(first.err, "has no coulomb_friction_Nm"), first, "says so",
       __LINE__);
  that(contains(first.out, "slope of the loop") && contains(first.out, "breakaway"), first,
       "prints", __LINE__);
  CHECK(!contains(content(folder / "n.ini"), "presliding-hysteresis"));
  CHECK(contains(content(folder / "n.ini"), "friction_knee_rad"));

  // A coarse encoder shows the bristle but does not let an observer follow it.
  std::string coarse = pushed::kMachine;
  coarse.replace(coarse.find("1000000"), 7, "10000");
  put("coarse.ini", coarse + "coulomb_friction_Nm = 0.014\n");
  put("coarse.csv", pushed::trace([](double f) { return f; }, 10000));
  const Outcome few =
      run("identify presliding --machine coarse.ini --trace coarse.csv --out c.ini");
  that(few.status == 0 && contains(few.err, "the knee alone is written"), few, "says so", __LINE__);
  that(contains(few.out, "after a reversal"), few, "tells it all the same", __LINE__);
  CHECK(!contains(content(folder / "c.ini"), "presliding-hysteresis"));
  CHECK(contains(content(folder / "c.ini"), "friction_knee_rad"));

  const auto refused = [](const std::string& trace, const std::string& ini, const char* why) {
    put("bad.csv", trace);
    put("bad.ini", ini);
    const Outcome bad = run("identify presliding --machine bad.ini --trace bad.csv --out b.ini");
    that(bad.status == 3 && one_sentence(bad.err) && contains(bad.err, why), bad, why, __LINE__);
  };
  refused(pushed::trace([](double f) { return std::abs(f); }), pushed::kMachine, "lost its sign");
  refused(pushed::trace(), std::string(pushed::kMachine) + "current_is_unsigned = yes\n",
          "has no sign");
  refused(pushed::trace([](double) { return 0.01; }), pushed::kMachine, "never changes");
}

}  // namespace

int main() { return in_own_folder("presliding_command", tests); }
