// Stable speeds from whole records, as controllers write them: the commands in the head of
// examples/machines/koike_cut.ini, and its encoder with more and fewer counts.
#include <sstream>
#include <string>

#include "check.hpp"
#include "program.hpp"

namespace {

using namespace program_test;

// Koike 2016, tables 8-10 and 8-11: pockets of the frequency-domain theory.
const double kPockets_rpm[] = {5747, 6321, 7023, 7900};

std::string with(std::string text, const std::string& from, const std::string& to) {
  const auto at = text.find(from);
  CHECK(at != std::string::npos);
  return at == std::string::npos ? text : text.replace(at, from.size(), to);
}

void four_of_four(const Outcome& o) {
  that(o.status == 0, o, "success", __LINE__);
  const Json json(o.out);
  that(json.ok && json.object, o, "one JSON object", __LINE__);
  CHECK_TEXT(json.text("verdict"), "found");
  const bool four = json.sizes.contains("stable_speeds") && json.sizes.at("stable_speeds") == 4;
  that(four, o, "four stable speeds", __LINE__);
  for (std::size_t i = 0; four && i < 4; ++i) {
    const std::string at = "stable_speeds." + std::to_string(i);
    CHECK_NEAR(json.number(at + ".spindle_speed_rpm"), kPockets_rpm[i], 30);
    // Two standard errors of one effective mode are 2 %; noise and views add to it.
    CHECK_BETWEEN(json.number(at + ".uncertainty_rpm"), 0.02 * kPockets_rpm[i],
                  0.03 * kPockets_rpm[i]);
  }
}

void whole_records() {
  const std::string machine = content("examples/machines/koike_cut.ini");
  CHECK(!machine.empty());
  put("koike_cut.ini", machine);
  const Outcome lobes = run("lobes --machine koike_cut.ini --report lobes.html");
  that(lobes.status == 0, lobes, "success", __LINE__);
  const Outcome cut = run("simulate milling --machine koike_cut.ini --out cut.csv --quiet");
  that(cut.status == 0, cut, "success", __LINE__);
  const Outcome found = run("pockets --machine koike_cut.ini --trace cut.csv --json");
  four_of_four(found);
  const Json json(found.out);
  // The ramp is the one in the cut, not the run-up (to 0.47 s) and not the run-down (from 2 s).
  CHECK(json.sizes.at("ramps") == 1);
  CHECK_BETWEEN(json.number("ramps.0.from_s"), 0.6, 0.85);
  CHECK_BETWEEN(json.number("ramps.0.to_s"), 1.7, 2.0);

  put("fine.ini", with(machine, "= 131072", "= 1048576"));
  run("simulate milling --machine fine.ini --out fine.csv --quiet");
  four_of_four(run("pockets --machine fine.ini --trace fine.csv --json"));
}

// So few counts that nothing could be seen: no word of a deeper cut, but how many it takes.
void hidden() {
  const std::string machine = content("examples/machines/koike_cut.ini");
  // 65536 counts tell all four: that many it takes, whatever the record has.
  for (const int counts : {8192, 16384, 32768}) {
    put("coarse.ini", with(machine, "= 131072", "= " + std::to_string(counts)));
    run("simulate milling --machine coarse.ini --out coarse.csv --quiet");
    const Outcome o = run("pockets --machine coarse.ini --trace coarse.csv --json");
    that(o.status == 0, o, "success", __LINE__);
    const Json json(o.out);
    CHECK_TEXT(json.text("verdict"), "hidden");
    CHECK(json.sizes.at("stable_speeds") == 0);
    that(!contains(o.out, "deeper"), o, "does not advise a deeper cut", __LINE__);
    that(contains(o.out, "times as many encoder counts"), o, "says how many counts", __LINE__);
    CHECK_BETWEEN(counts * json.number("counts_factor"), 46341, 92682);
  }
}

// Cutting torque beside counts.
void torque_beside_counts() {
  const std::string machine = content("examples/machines/koike_cut.ini");
  put("ideal.ini", machine);
  run("simulate milling --machine ideal.ini --out ideal.csv --ideal-drives --quiet");
  std::string text = "t_s,spindle.angle_counts,spindle.torque_Nm\n";
  for (const std::string& line : lines(content(folder / "ideal.csv"))) {
    if (line.empty() || line[0] == '#' || line[0] == 't') continue;
    std::stringstream in(line);
    std::string t, angle, speed, torque;
    std::getline(in, t, ',');
    std::getline(in, angle, ',');
    std::getline(in, speed, ',');
    std::getline(in, torque, ',');
    const double turns = std::strtod(angle.c_str(), nullptr) / 6.283185307179586;
    text += t + ',' + std::to_string(static_cast<long long>(131072 * turns)) + ',' + torque + '\n';
  }
  put("counts.csv", text);
  four_of_four(run("pockets --machine ideal.ini --trace counts.csv --json"));
}

}  // namespace

int main() {
  return program_test::in_own_folder("pockets_command", [] {
    whole_records();
    hidden();
    torque_beside_counts();
  });
}
