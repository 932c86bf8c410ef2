// A section is taught from sound cuts and watched: sound, with a tooth broken in the cut, at
// another rate, with another tool, without a column; as a user meets it.
#include <cmath>
#include <string>

#include "check.hpp"
#include "identify/reference_cuts.hpp"
#include "program.hpp"

namespace {

using namespace program_test;
using namespace reference_cuts;

const char* const kNamed = "\n[monitor.reference]\nreference = sound.txt\n";

Job job() {
  std::mt19937 random(42);
  return any_job(random);
}

void cut(const std::string& name, const Job& j, Fault fault, unsigned seed) {
  std::mt19937 random(seed);
  record((folder / name).string(), j, any_sound(random), fault, 0.4, seed);
}

/// Index of the reference among the monitors.
std::string line_of(const Json& json) {
  for (std::size_t i = 0; i < json.sizes.at("monitors"); ++i)
    if (json.text("monitors." + std::to_string(i) + ".name") == "reference")
      return "monitors." + std::to_string(i);
  return "absent";
}

void taught_and_watched() {
  const Job j = job();
  machine((folder / "m.ini").string(), j, kNamed);
  for (unsigned k = 1; k <= 3; ++k) cut("sound" + std::to_string(k) + ".csv", j, Fault::none, k);
  const Outcome taught =
      run("identify reference --quiet --machine m.ini --out sound.txt sound1.csv sound2.csv "
          "sound3.csv");
  that(taught.status == 0 && contains(taught.out, "threshold"), taught, "learns", __LINE__);
  cut("sound.csv", j, Fault::none, 77);
  cut("broken.csv", j, Fault::broken, 78);
  for (const bool broken : {false, true}) {
    const Outcome o =
        run(std::string("monitor --quiet --json --fail-on-alarm --machine m.ini --trace ") +
            (broken ? "broken.csv" : "sound.csv") + " --report page.html --events events.jsonl");
    that(o.status == (broken ? 1 : 0), o, broken ? "alarms" : "is silent", __LINE__);
    const Json json(o.out);
    CHECK(json.ok);
    const std::string monitor = line_of(json);
    CHECK(json.text(monitor + ".runs") == "true");
    CHECK(json.number(monitor + ".sees_from.value") > 1);
    CHECK(json.number(monitor + ".watched_s") > 1);
    // Windows tile; above the threshold it is in alarm, else not.
    CHECK(json.sizes.contains("reference"));
    const std::size_t n = json.sizes.count("reference") ? json.sizes.at("reference") : 0;
    CHECK(n > 10);
    std::size_t compared = 0, above = 0;
    double before = json.number("from_s");
    for (std::size_t i = 0; i < n; ++i) {
      const std::string w = "reference." + std::to_string(i) + ".";
      CHECK(json.number(w + "from_s") == before);
      before = json.number(w + "to_s");
      CHECK(json.number(w + "threshold") > 1);
      if (json.text(w + "distance") == "null") continue;
      ++compared;
      const bool is_above = json.number(w + "distance") > json.number(w + "threshold");
      above += is_above;
      // The tooth breaks at 0.4 of 2.4 s of cut, which begins at 0.4 to 0.6 s.
      if (is_above) CHECK(json.number(w + "to_s") > 0.4 + 0.4 * 2.4);
    }
    CHECK_NEAR(before, json.number("to_s"), 1e-9);
    CHECK(compared > n / 3);
    CHECK(json.text("reference.0.distance") == "null");  // air
    CHECK(broken ? above > 3 : above == 0);
    CHECK((json.number("alarms") > 0) == (above > 0));
    CHECK(contains(o.out, "times its sound level") == broken);
    CHECK(contains(content(folder / "page.html"), "Sound reference"));
    CHECK(contains(content(folder / "events.jsonl"), "\"monitor\": \"reference\""));
  }
}

/// Why the reference does not run on that trace, with that machine file.
std::string refused(const std::string& ini, const std::string& trace) {
  const Outcome o = run("monitor --quiet --json --machine " + ini + " --trace " + trace);
  that(o.status == 0, o, "works without it", __LINE__);
  const Json json(o.out);
  const std::string monitor = line_of(json);
  CHECK(json.text(monitor + ".runs") == "false");
  CHECK(json.sizes.contains("reference") && json.sizes.at("reference") == 0);
  CHECK(json.text("verdict") != "clear");
  return json.text(monitor + ".reason");
}

void other_records() {
  Job j = job();
  CHECK(contains(refused("m.ini",
                         [&] {
                           Job fast = j;
                           fast.rate_hz *= 1.5;
                           cut("fast.csv", fast, Fault::none, 5);
                           return std::string("fast.csv");
                         }()),
                 "the reference is of"));
  Job other = j;
  other.teeth += 1;
  machine((folder / "teeth.ini").string(), other, kNamed);
  CHECK(contains(refused("teeth.ini", "sound.csv"), "teeth"));
  other = j;
  other.radius_m *= 2;
  machine((folder / "large.ini").string(), other, kNamed);
  CHECK(contains(refused("large.ini", "sound.csv"), "the reference is of a tool of"));

  // Without the current of x: compared by the rest, and that is said.
  std::string text;
  for (const std::string& line : lines(content(folder / "sound.csv")))
    text += line.substr(0, line.rfind(',')) + "\n";
  put("less.csv", text);
  const Outcome less = run("monitor --quiet --json --machine m.ini --trace less.csv");
  that(less.status == 0 && contains(less.out, "x.current_A of the reference is not in the record"),
       less, "says what it lacks", __LINE__);
  CHECK(Json(less.out).text(line_of(Json(less.out)) + ".runs") == "true");
}

void files() {
  const Job j = job();
  machine((folder / "none.ini").string(), j);
  const Outcome none = run("monitor --quiet --json --machine none.ini --trace sound.csv");
  const Json json(none.out);
  CHECK(contains(json.text(line_of(json) + ".reason"), "identify reference"));
  CHECK(!json.sizes.contains("reference"));
  machine((folder / "absent.ini").string(), j, "\n[monitor.reference]\nreference = absent.txt\n");
  const Outcome absent = run("monitor --quiet --machine absent.ini --trace sound.csv");
  that(absent.status == 4 && one_sentence(absent.err), absent, "no such file", __LINE__);
  put("bad.txt", "format = servosense reference 7\n");
  machine((folder / "bad.ini").string(), j, "\n[monitor.reference]\nreference = bad.txt\n");
  const Outcome bad = run("monitor --quiet --machine bad.ini --trace sound.csv");
  that(bad.status == 3 && one_sentence(bad.err) && contains(bad.err, "bad.txt:1:"), bad,
       "another format", __LINE__);
  machine((folder / "off.ini").string(), j,
          "\n[monitor.reference]\nenabled = no\nreference = absent.txt\n");
  const Outcome off = run("monitor --quiet --json --machine off.ini --trace sound.csv");
  that(off.status == 0 && contains(off.out, "switched off"), off, "is not read", __LINE__);
  const Outcome nothing = run("identify reference --machine m.ini --out r.txt");
  that(nothing.status == 2, nothing, "needs traces", __LINE__);
}

void tests() {
  taught_and_watched();
  other_records();
  files();
}

}  // namespace

int main() { return program_test::in_own_folder("reference", tests); }
