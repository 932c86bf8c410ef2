// The program as a user meets it: exit status, standard output and standard error of whole commands
// on generated traces of a known axis.
#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <random>
#include <string>
#include <vector>

#include "check.hpp"
#include "oracles/drive_plant.hpp"
#include "program.hpp"

namespace {

using namespace program_test;

// ---- a known axis ------------------------------------------------------------------------------

constexpr double kRate_hz = 8000;
constexpr double kMass_kg = 227, kViscous = 732, kCoulomb_N = 94;  // Koike 2016, table 3-4, X
constexpr double kLead_m = 0.016, kCounts = 1 << 20, kTorque_Nm_per_A = 1;
constexpr double kForce_N_per_A = kTorque_Nm_per_A * 2 * oracle::kPi / kLead_m;

// To and fro at 0.8 m/s with dwells, and at 0.2 m/s without, so that reversals show.
struct TwoPaces {
  oracle::Reciprocating fast{0.2, 0.8, 0.16, 0.05};
  oracle::Reciprocating slow{0.05, 0.2, 0.08, 0};
  [[nodiscard]] double cycle_s() const { return fast.cycle_s() + slow.cycle_s(); }
  [[nodiscard]] oracle::Motion at(double t) const {
    t = std::fmod(t, cycle_s());
    return t < fast.cycle_s() ? fast.at(t) : slow.at(t - fast.cycle_s());
  }
};

constexpr double kContact_s = 1.78;  // in the cruise of the second fast stroke

struct Recording {
  unsigned seed = 1;
  double contact_s = -1;     ///< 333 kN/s for 4 ms from then on, then the tool breaks
  double held_N = 0;         ///< a steady cutting force...
  double held_from_s = 1e9;  ///< ...from then on
  int rows = 2 * 12640;      ///< two cycles
};

// Counts and current of the axis that follows TwoPaces exactly: inverse dynamics in closed form.
void record(const std::string& name, const Recording& r) {
  std::mt19937 random(r.seed);
  std::normal_distribution<double> noise_N(0, 15);
  const TwoPaces motion;
  oracle::Bristle bristle;
  std::string text = "# machine: simulated\nt_s,x.angle_counts,x.current_A\n";
  double last = 0;
  for (int n = 0; n < r.rows; ++n) {
    const double t = n / kRate_hz;
    const oracle::Motion m = motion.at(t);
    double force = kMass_kg * m.a + kViscous * m.v + kCoulomb_N * bristle.follow(m.x - last);
    last = m.x;
    if (r.contact_s >= 0 && t >= r.contact_s && t < r.contact_s + 4e-3)
      force += 333e3 * (t - r.contact_s);
    if (t >= r.held_from_s) force += r.held_N;
    char line[96];
    std::snprintf(line, sizeof line, "%.6f,%lld,%.9g\n", t,
                  static_cast<long long>(std::floor(m.x / kLead_m * kCounts)),
                  (force + noise_N(random)) / kForce_N_per_A);
    text += line;
  }
  put(name, text);
}

// What the user knows before identification: scales, no friction, no thresholds.
const char* const kBareMachine =
    "[machine]\nname = test bed\nsample_rate_hz = 8000\n\n"
    "[axis.x]\nlead_m = 0.016\ntorque_constant_Nm_per_A = 1\nencoder_counts_per_rev = 1048576\n";

// ---- usage -------------------------------------------------------------------------------------

void help() {
  const Outcome top = run("--help");
  that(top.status == 0 && top.err.empty(), top, "status 0, silent on standard error", __LINE__);
  for (const std::string command : {"monitor", "identify idle", "report"}) {
    that(contains(top.out, "  " + command + " "), top, "lists " + command, __LINE__);
    const Outcome o = run(command + " --help");
    that(o.status == 0 && o.err.empty(), o, "status 0, silent on standard error", __LINE__);
    for (const char* part : {"usage: servosense ", "--json", "--quiet", "--help", "exit status"})
      that(contains(o.out, part), o, std::string("explains ") + part, __LINE__);
  }
  const Outcome monitor = run("monitor --help");
  for (const char* option : {"--machine FILE", "--trace FILE", "--events FILE|-",
                             "--estimates FILE", "--report FILE", "--fail-on-alarm"})
    that(contains(monitor.out, option), monitor, std::string("explains ") + option, __LINE__);
  for (const auto& [asked, same] : {std::pair{"-h", "--help"},
                                    {"help", "--help"},
                                    {"help identify idle", "identify idle --help"},
                                    {"monitor -h", "monitor --help"},
                                    {"identify -h", "help identify"}}) {
    const Outcome o = run(asked);
    that(o.status == 0 && !o.out.empty() && o.out == run(same).out, o,
         std::string("the same as ") + same, __LINE__);
  }
  const Outcome group = run("identify --help");
  that(contains(group.out, "  identify idle ") && !contains(group.out, "  monitor "), group,
       "lists the commands of the group alone", __LINE__);
  // Columns line up: the second one begins at the same place in every row.
  std::size_t column = 0;
  for (const std::string& row : lines(top.out)) {
    const std::size_t gap = row.find("  ", 2);
    if (!row.starts_with("  ") || gap == std::string::npos) continue;
    const std::size_t begins = row.find_first_not_of(' ', gap);
    if (column == 0) column = begins;
    that(begins == column, top, "lines up: " + row, __LINE__);
  }
  const Outcome version = run("--version");
  that(version.status == 0 && version.out.starts_with("servosense "), version, "version", __LINE__);
  const Outcome none = run("");
  that(none.status == 2 && none.out.empty() && contains(none.err, "usage:"), none,
       "usage on standard error", __LINE__);
}

void wrong_usage() {
  refused("moniter", 2, {"'moniter'", "'monitor'"}, __LINE__);
  refused("help moniter", 2, {"'moniter'", "'monitor'"}, __LINE__);
  refused("moniter --json", 2, {"'moniter'"}, __LINE__);
  refused("monitor --json --trace t.csv", 2, {"needs --machine FILE"}, __LINE__);
  refused("identify", 2, {"'identify'", "'identify idle'"}, __LINE__);
  refused("identify idel --machine m.ini", 2, {"'identify idel'", "'identify idle'"}, __LINE__);
  refused("monitor --machin m.ini --trace t.csv", 2, {"'--machin'", "'--machine'"}, __LINE__);
  refused("report --uot r.html e.jsonl", 2, {"'--uot'", "'--out'"}, __LINE__);
  refused("monitor --trace t.csv", 2, {"needs --machine FILE", "--help"}, __LINE__);
  refused("monitor --machine m.ini", 2, {"one of --trace FILE", "--modbus URL"}, __LINE__);
  refused("identify idle --machine m.ini --trace t.csv", 2, {"needs --out FILE"}, __LINE__);
  refused("report --out r.html", 2, {"event file", "--events"}, __LINE__);
  refused("monitor --machine", 2, {"'--machine' needs a value"}, __LINE__);
  refused("monitor --machine --trace t.csv", 2, {"'--machine' needs a value"}, __LINE__);
  refused("monitor --machine m.ini --machine m.ini --trace t.csv", 2, {"given twice"}, __LINE__);
  refused("monitor --machine m.ini --trace t.csv more", 2, {"'more' is not expected"}, __LINE__);
  refused("monitor --machine m.ini --trace t.csv --json --events -", 2,
          {"--json", "standard output"}, __LINE__);
  for (const char* option : {"--proof-trace", "--changed-since"})
    refused("reconcile --machine bare.ini --trace idle.csv --out same " + std::string(option) +
                " ./idle.csv",
            2, {option, "is the trace itself"}, __LINE__);
  const std::string decided =
      "reconcile --machine bare.ini --trace idle.csv --out same --criterion least_explained=0.4 ";
  refused(decided + "--criterion least_explaind=0.4", 2,
          {"no criterion 'least_explaind'", "least_explained", "class_standard_errors"}, __LINE__);
  refused(decided + "--criterion least_explained=most", 2, {"NAME=VALUE", "least_explained=most"},
          __LINE__);
  for (const char* rate : {"0", "-1", "often", "1e999", "nan"})
    refused(
        "identify idle --machine m.ini --trace idle.csv --out o.ini "
        "--false-alarm-rate-per-hour " +
            std::string(rate),
        2, {"positive number", std::string("'") + rate + "'"}, __LINE__);
}

// ---- bad input ---------------------------------------------------------------------------------

void missing_files() {
  const std::string trace = " --trace idle.csv";
  refused("monitor --machine none.ini" + trace, 4, {"none.ini"}, __LINE__);
  refused("monitor --machine bare.ini --trace none.csv", 4, {"none.csv"}, __LINE__);
  refused("report --out r.html none.jsonl", 4, {"none.jsonl"}, __LINE__);
  for (const char* option : {"--events", "--estimates", "--report"})
    refused("monitor --quiet --json --machine bare.ini" + trace + " " + option + " no/such/file", 4,
            {"no/such/file"}, __LINE__);
  refused("identify idle --quiet --machine bare.ini" + trace + " --out no/such/file", 4,
          {"no/such/file"}, __LINE__);
}

void malformed_input() {
  const std::string head = "t_s,x.angle_counts,x.current_A\n";
  struct Case {
    const char* name;
    std::string text;
    std::string part;
  };
  std::string late = head;  // beyond what is read ahead to find the rate
  for (int n = 0; n < 3000; ++n)
    late += std::to_string(125 * n) + "e-6," + std::to_string(n) + ",0.1\n";
  const std::string good = late;
  late += "3.0,12\n";
  const std::vector<Case> cases = {
      {"short.csv", head + "0,1,2\n0.1,2\n", "short.csv:3"},
      {"word.csv", head + "0,1,2\n0.1,two,3\n", "word.csv:3"},
      {"back.csv", head + "0,1,2\n0.1,2,3\n0.05,2,3\n", "back.csv:4"},
      {"infinite.csv", head + "0,1,inf\n", "infinite.csv:2"},
      {"column.csv", "t_s,x.angle_count\n0,1\n", "column.csv:1"},
      {"late.csv", late, "late.csv:3002"},
      {"empty.csv", "", "empty.csv"},
      {"one_row.csv", head + "0,1,2\n", "one_row.csv"},
      {"no_effort.csv", "t_s,x.angle_counts\n0,1\n0.1,2\n", "no_effort.csv"},
  };
  for (const Case& c : cases) {
    put(c.name, c.text);
    refused("monitor --quiet --machine bare.ini --trace " + std::string(c.name), 3, {c.part},
            __LINE__);
    refused("identify idle --quiet --machine bare.ini --out o.ini --trace " + std::string(c.name),
            3, {c.part}, __LINE__);
  }
  put("slow.csv", good);
  put("wrong.ini", "[machine]\nname = x\n\n[axis.x]\nled_m = 0.016\n");
  refused("monitor --machine wrong.ini --trace slow.csv", 3, {"wrong.ini:5", "lead_m"}, __LINE__);
  // All faults of a file at once, one a line.
  put("three.ini",
      "[axis.x]\nled_m = 0.016\n[spindel]\nanything = 1\n[spindle]\ninertia_kg_m2 = ten\n");
  const Outcome three = run("monitor --machine three.ini --trace slow.csv --json");
  that(three.status == 3 && lines(three.err).size() == 3, three, "three faults", __LINE__);
  for (const char* part : {"three.ini:2", "three.ini:3", "three.ini:6"})
    that(contains(three.err, part) && contains(three.out, part), three, part, __LINE__);
  put("unfit.ini", "[machine]\nname = x\n\n[axis.x]\nlead_m = 0.016\n");
  refused("monitor --machine unfit.ini --trace slow.csv", 3,
          {"unfit.ini:4", "encoder_counts_per_rev"}, __LINE__);
  put("other.ini", "[machine]\nname = x\n");
  refused("monitor --machine other.ini --trace slow.csv", 3, {"[axis.x]", "other.ini"}, __LINE__);
  put("broken.jsonl", "{\"t_s\": 1}\n");
  refused("report --out r.html broken.jsonl", 3, {"broken.jsonl:1"}, __LINE__);
  // One direction at one speed cannot be identified; the sentence says what to record.
  refused("identify idle --quiet --machine bare.ini --trace slow.csv --out o.ini", 3, {"x"},
          __LINE__);
  CHECK(!fs::exists(folder / "o.ini"));
}

// ---- work --------------------------------------------------------------------------------------

void identify() {
  const Outcome o =
      run("identify idle --machine bare.ini --trace idle.csv --out learned.ini --json");
  that(o.status == 0, o, "done", __LINE__);
  const Json json(o.out);
  that(json.ok && json.object, o, "one JSON object", __LINE__);
  CHECK_TEXT(json.text("drives.0.channel"), "x");
  CHECK_TEXT(json.text("out"), "learned.ini");
  // The parameters that the trace was made with.
  CHECK_NEAR(json.number("drives.0.equivalent_mass_kg.value"), kMass_kg, 0.01 * kMass_kg);
  CHECK_NEAR(json.number("drives.0.viscous_friction_N_s_per_m.value"), kViscous, 0.01 * kViscous);
  CHECK_NEAR(json.number("drives.0.coulomb_friction_N.value"), kCoulomb_N, 0.01 * kCoulomb_N);
  const double threshold = json.number("drives.0.collision_threshold_N_per_s");
  CHECK_NEAR(json.number("drives.0.friction_knee_m"), 5e-6, 1e-12);
  // Above this trace's noise, below the threshold of a real axis (Koike 2016, section 5.4).
  CHECK_BETWEEN(threshold, 500.0, 14.58e3);
  check::figure("collision threshold learned", threshold, "N/s");
  const std::string machine = content(folder / "learned.ini");
  for (const char* part : {"name = test bed", "equivalent_mass_kg", "[detectability.x]",
                           "[monitor.collision]", "threshold_x_N_per_s", "provenance"})
    that(contains(machine, part), o, std::string("writes ") + part, __LINE__);
  // For people: the same figures as text.
  const Outcome text = run("identify idle --machine bare.ini --trace idle.csv --out again.ini");
  that(text.status == 0 && contains(text.out, "equivalent mass") &&
           contains(text.out, "written to again.ini"),
       text, "prints what was found", __LINE__);
  CHECK_TEXT(content(folder / "again.ini"), machine);
  const Outcome quiet =
      run("identify idle --quiet --machine bare.ini --trace idle.csv --out again.ini");
  that(quiet.status == 0 && quiet.err.empty(), quiet, "--quiet", __LINE__);
}

void monitor_idle() {
  const Outcome o =
      run("monitor --machine learned.ini --trace idle2.csv --json --fail-on-alarm --quiet");
  that(o.status == 0 && o.err.empty(), o, "no alarm, silent", __LINE__);
  const Json json(o.out);
  that(json.ok && json.object, o, "one JSON object", __LINE__);
  CHECK_TEXT(json.text("alarms"), "0");
  CHECK_TEXT(json.text("samples"), "25280");
  CHECK_TEXT(json.text("machine"), "test bed");
  CHECK_NEAR(json.number("sample_rate_hz"), 8000, 1e-6);
  // All monitors are accounted for: chatter, three of collision, five of the tool, the reference,
  // one signal.
  CHECK(json.sizes.contains("monitors") && json.sizes.at("monitors") == 11);
  // Without a threshold nothing runs, and the summary says what to do.
  const Outcome bare = run("monitor --machine bare.ini --trace idle2.csv");
  that(bare.status == 0 && contains(bare.out, "servosense identify idle"), bare,
       "says why it does not run", __LINE__);
}

void monitor_contact() {
  const double contact_s = kContact_s;
  const std::string words = "monitor --machine learned.ini --trace contact.csv ";
  const Outcome json_run = run(words + "--json");
  that(json_run.status == 0, json_run, "an alarm alone is no failure", __LINE__);
  const Json json(json_run.out);
  that(json.ok && json.object, json_run, "one JSON object", __LINE__);
  CHECK_TEXT(json.text("alarms"), "1");
  const Outcome failing = run(words +
                              "--fail-on-alarm --events events.jsonl "
                              "--estimates estimates.csv --report report.html");
  that(failing.status == 1, failing, "--fail-on-alarm", __LINE__);
  that(contains(failing.out, "Verdict: alarm.") && contains(failing.out, "1 alarm, ") &&
           contains(failing.out, "collision"),
       failing, "summary", __LINE__);

  // Events: the file and standard output say the same, one JSON object a line.
  const Outcome streamed = run(words + "--events -");
  that(streamed.status == 0, streamed, "done", __LINE__);
  CHECK_TEXT(streamed.out, content(folder / "events.jsonl"));
  double alarm_s = -1, last_s = -1;
  for (const std::string& line : lines(streamed.out)) {
    const Json event(line);
    that(event.ok && event.object && event.sizes.size() == 1 && event.scalars.size() == 8, streamed,
         "one object of the eight keys a line", __LINE__);
    for (const char* key :
         {"t_s", "monitor", "channel", "state", "value", "threshold", "unit", "reason"})
      that(event.scalars.contains(key), streamed, std::string("key ") + key, __LINE__);
    CHECK_TEXT(event.text("channel"), "x");
    const bool signal = event.text("monitor") == "signal";
    if (!signal) CHECK_TEXT(event.text("monitor"), "collision");
    CHECK_TEXT(event.text("unit"), signal ? "1" : "N/s");
    CHECK(event.number("t_s") >= last_s);
    CHECK(event.text("t_s").size() <= 8);  // as the trace spells it: 1.780125
    last_s = event.number("t_s");
    if (event.text("state") != "alarm") continue;
    alarm_s = event.number("t_s");
    CHECK(event.number("value") >= event.number("threshold"));
  }
  CHECK_BETWEEN(alarm_s - contact_s, 0.0, 3e-3);
  check::figure("contact to alarm", 1e3 * (alarm_s - contact_s), "ms");

  const std::string report = content(folder / "report.html");
  CHECK(report.starts_with("<!") && contains(report, "</html>") && contains(report, "<svg"));
  CHECK(contains(report, "collision") && contains(report, "alarm"));
  for (const char* outside : {"<link", "<script src", "@import", "src=\"http", "href=\"http",
                              "url(http", "src=\"//", "fetch("})
    check::that(!contains(report, outside), (std::string("report has no ") + outside).c_str(),
                __FILE__, __LINE__);

  const Outcome pictures = run("report --out events.html events.jsonl --json");
  const Json summary(pictures.out);
  that(pictures.status == 0 && summary.ok && summary.object, pictures, "one JSON object", __LINE__);
  CHECK_TEXT(summary.text("alarms"), "1");
  CHECK(summary.number("events") == static_cast<double>(lines(streamed.out).size()));
  CHECK(contains(content(folder / "events.html"), "</html>"));
}

// A steady force of 200 N comes out as such, at the instants of the trace.
void estimates() {
  const Outcome o =
      run("monitor --quiet --machine learned.ini --trace held.csv --estimates held_estimates.csv");
  that(o.status == 0, o, "done", __LINE__);
  const auto trace = lines(content(folder / "held.csv"));
  std::vector<std::string> rows;
  for (const std::string& line : lines(content(folder / "held_estimates.csv")))
    if (!line.starts_with("#")) rows.push_back(line);
  CHECK(rows.size() == trace.size() - 1);  // the trace has one line of metadata
  CHECK_TEXT(rows.at(0), "t_s,x.force_N,x.force_band_N");
  bool same_times = true, banded = true;
  double before = 0, during = 0, counted_before = 0, counted_during = 0;
  for (std::size_t i = 1; i < std::min(rows.size(), trace.size() - 1); ++i) {
    double t = 0, force = 0, band = 0;
    if (std::sscanf(rows[i].c_str(), "%lf,%lf,%lf", &t, &force, &band) != 3) continue;
    banded = banded && band > 0;
    const double t_trace = std::strtod(trace[i + 1].c_str(), nullptr);
    same_times = same_times && std::abs(t - t_trace) < 1e-9;
    if (t > 0.2 && t < 1.6) before += force, ++counted_before;
    if (t > 1.8) during += force, ++counted_during;
  }
  CHECK(same_times);
  CHECK(banded);
  CHECK(counted_before > 10'000 && counted_during > 10'000);
  // 15 N of white noise, averaged over 10 000 samples and more, and the errors of the parameters.
  CHECK_NEAR(before / counted_before, 0.0, 2.0);
  CHECK_NEAR(during / counted_during, 200.0, 2.0);
}

// Rows that are missing, and values marked invalid: said, bridged, no alarm.
void damaged_trace() {
  const auto good = lines(content(folder / "idle2.csv"));
  std::string text;
  for (std::size_t i = 0; i < good.size(); ++i) {
    const std::size_t phase = i % 4001;
    if (i > 2000 && phase < 3) continue;                     // a short hole
    if (i > 2000 && phase > 1900 && phase < 1960) continue;  // a long one
    std::string line = good[i];
    if (i > 2000 && phase == 1000) line.replace(line.rfind(',') + 1, std::string::npos, "nan");
    text += line + "\n";
  }
  put("damaged.csv", text);
  const Outcome o =
      run("monitor --quiet --json --machine learned.ini --trace damaged.csv --report damaged.html");
  const Json json(o.out);
  that(o.status == 0 && json.ok, o, "done", __LINE__);
  CHECK_TEXT(json.text("alarms"), "0");
  CHECK(json.number("missing_samples") ==
        static_cast<double>(good.size()) -
            static_cast<double>(std::count(text.begin(), text.end(), '\n')));
  // What is said to have been there are the rows; a comment and the header stand above them.
  CHECK(json.number("samples") ==
        static_cast<double>(std::count(text.begin(), text.end(), '\n') - 2));
  CHECK(contains(o.out, "signal-fault"));
  CHECK(contains(content(folder / "damaged.html"), "missing from the trace"));
}

// A trace at another rate than the machine file states is refused with the remedy; where the file
// states that rate, what was learned at another does not watch.
void other_rate() {
  const auto full = lines(content(folder / "idle2.csv"));
  std::string text = full[0] + "\n" + full[1] + "\n";
  for (std::size_t i = 2; i < full.size(); i += 8) text += full[i] + "\n";
  put("one_khz.csv", text);
  refused("monitor --machine learned.ini --trace one_khz.csv", 3,
          {"1000 Hz", "sample_rate_hz = 8000 in learned.ini", "identify idle"}, __LINE__);
  std::string machine = content(folder / "learned.ini");
  machine.replace(machine.find("sample_rate_hz = 8000"), 21, "sample_rate_hz = 1000");
  put("one_khz.ini", machine);
  const Outcome o = run("monitor --machine one_khz.ini --trace one_khz.csv --fail-on-alarm");
  that(o.status == 1 && contains(o.out, "Verdict: not-watched.") &&
           contains(o.out, "collision on x (other conditions)") &&
           contains(o.out, "sample rate [Hz] 8000, now 1000"),
       o, "says what differs", __LINE__);
  for (const std::string& line : lines(o.err))
    that(line.starts_with("servosense: note: "), o, "notes are marked", __LINE__);
  const Outcome quiet = run("monitor --machine one_khz.ini --trace one_khz.csv --quiet");
  that(quiet.status == 0 && quiet.err.empty(), quiet, "--quiet", __LINE__);
}

}  // namespace

int main() {
  return in_own_folder("cli", [] {
    put("bare.ini", kBareMachine);
    record("idle.csv", {});
    Recording other;
    other.seed = 2;
    record("idle2.csv", other);
    Recording contact;
    contact.seed = 3;
    contact.contact_s = kContact_s;
    record("contact.csv", contact);
    Recording held;
    held.seed = 4;
    held.held_N = 200;
    held.held_from_s = 1.7;
    record("held.csv", held);

    help();
    wrong_usage();
    missing_files();
    malformed_input();
    identify();
    monitor_idle();
    monitor_contact();
    estimates();
    damaged_trace();
    other_rate();
  });
}
