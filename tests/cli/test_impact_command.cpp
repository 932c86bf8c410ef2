// servosense identify impact: hits of a tool of known modes from their traces to receptance files
// of every format, JSON and page; every refusal in one sentence.
#include <cmath>
#include <complex>
#include <string>
#include <vector>

#include "check.hpp"
#include "cli/hammer_trace.hpp"
#include "program.hpp"
#include "servosense/io/frf_file.hpp"

namespace {

using namespace program_test;
using namespace hammer_test;
using servosense::FrequencyResponse;

/// Worst deviation from the truth from 200 to 2500 Hz, over the highest receptance.
double off_file(const std::string& name, double factor = 1) {
  const auto f = servosense::read_frf((folder / name).string());
  check::that(f.has_value(), ("reads " + name).c_str(), __FILE__, __LINE__);
  if (!f) {
    std::cout << f.error().sentence << '\n';
    return 1;
  }
  double worst = 0, highest = 0;
  for (std::size_t i = 0; i < f->frequency_hz.size(); ++i) {
    const double hz = f->frequency_hz[i];
    if (hz < 200 || hz > 2500) continue;
    const auto truth = factor * receptance(kTool, {f->exponential_window_per_s, kTurn * hz});
    highest = std::max(highest, std::abs(truth));
    worst = std::max(worst, std::abs(f->receptance_m_per_N[i] - truth));
  }
  return worst / highest;
}

Bench bench(int derivative = 0) {
  Bench b;
  b.derivative = derivative;
  b.force_noise_N = 0.5, b.force_offset_N = 2;
  b.response_noise = derivative == 0 ? 1e-8 : 0.5;
  return b;
}

void good_hits() {
  std::string files, accelerations;
  for (unsigned i = 0; i < 5; ++i) {
    const std::string n = std::to_string(i);
    put("h" + n + ".csv", trace({{0.01 + 0.001 * i, 300.0 + 30 * i, 0.0006}}, bench(), 81000 + i));
    put("a" + n + ".csv", trace({{0.01 + 0.001 * i, 300.0 + 30 * i, 0.0006}}, bench(2), 81010 + i,
                                kTool, "tool.acceleration_y_m_s2"));
    files += " h" + n + ".csv";
    accelerations += " a" + n + ".csv";
  }
  put("twice.csv", trace({{0.01, 300, 0.0006}, {0.021, 90, 0.0006}}, bench(), 81020));
  const Outcome o =
      run("identify impact --json --quiet --out tip.csv --report tip.html" + files + " twice.csv");
  that(o.status == 0, o, "works", __LINE__);
  const Json json(o.out);
  that(json.ok && json.object, o, "prints one object", __LINE__);
  CHECK(json.number("averages") == 5);
  CHECK(json.sizes.contains("hits") && json.sizes.at("hits") == 6);
  CHECK_TEXT(json.text("hits.0.trace"), "h0.csv");
  CHECK_TEXT(json.text("hits.0.used"), "true");
  CHECK_TEXT(json.text("hits.0.reason"), "");
  CHECK_TEXT(json.text("hits.5.trace"), "twice.csv");
  CHECK_TEXT(json.text("hits.5.used"), "false");
  CHECK(json.text("hits.5.reason").starts_with("double hit"));
  CHECK(json.number("usable_to_hz") > 2500);
  CHECK_NEAR(json.number("peak_hz"), 620, 10);
  const std::string table = content(folder / "tip.csv");
  CHECK(contains(table,
                 "\nfrequency_hz,receptance_re_m_per_N,receptance_im_m_per_N,coherence,"
                 "standard_error_m_per_N\n"));
  CHECK(off_file("tip.csv") < 0.01);
  const std::string page = content(folder / "tip.html");
  CHECK(contains(page, "<svg") && contains(page, "double hit") && contains(page, "coherence"));
  for (const std::string name : {"tip.uff", "tip.txt", "odd.csv --format uff58"}) {
    const Outcome other = run("identify impact --quiet --out " + name + accelerations);
    that(other.status == 0, other, "works", __LINE__);
    CHECK(off_file(name.substr(0, name.find(' '))) < 0.02);
  }
  CHECK(content(folder / "odd.csv").starts_with("    -1\n   164\n"));
  const Outcome above =
      run("identify impact --quiet --out above.csv --offset-m 0.015 "
          "--stick-out-m 0.08" +
          files);
  that(above.status == 0, above, "works", __LINE__);
  CHECK(off_file("above.csv", 1.3850) < 0.01);
  const Outcome words = run("identify impact --out tip2.csv" + files + " twice.csv");
  that(words.status == 0 && contains(words.out, "5 of 6 hits used") &&
           contains(words.out, "not used, twice.csv at 0.01"),
       words, "says which hit is not used", __LINE__);
  // What it writes is what 'lobes' takes.
  put("cut.ini",
      "[spindle]\ninertia_kg_m2 = 0.01\n[tool]\ndiameter_m = 0.016\nteeth = 4\n"
      "tangential_coefficient_N_per_m2 = 8e8\nradial_ratio = 0.3\n"
      "[cut]\nfeed_per_tooth_m = 1e-4\naxial_depth_m = 0.001\nradial_immersion_m = "
      "0.008\ndirection = "
      "down\nspindle_speed_rpm = 6000\n"
      "[structure.x]\nfrf = tip.csv\n[structure.y]\nfrf = tip.uff\n");
  const Outcome lobes = run("lobes --quiet --machine cut.ini --speeds 20 --out lobes.csv");
  that(lobes.status == 0, lobes, "takes both formats", __LINE__);
}

void refusals() {
  const std::string command = "identify impact --out no.csv ";
  refused(command + "twice.csv", 3, {"twice.csv", "double hit (1)", "later"}, __LINE__);
  refused(command + "--json twice.csv", 3, {"double hit"}, __LINE__);
  CHECK(!fs::exists(folder / "no.csv"));
  put("force.csv", "t_s,hammer.force_N\n0,1\n1,2\n2,3\n");
  refused(command + "force.csv", 3, {"tool.displacement_x_m"}, __LINE__);
  put("tool.csv", "t_s,tool.displacement_x_m\n0,1\n1,2\n2,3\n");
  refused(command + "tool.csv", 3, {"hammer.force_N"}, __LINE__);
  put("both.csv", "t_s,hammer.force_N,tool.displacement_x_m,tool.displacement_y_m\n0,1,1,1\n");
  refused(command + "both.csv", 2, {"--response"}, __LINE__);
  refused(command + "h0.csv a0.csv", 3, {"a0.csv", "one response"}, __LINE__);
  refused(command + "h0.csv --offset-m 0.08 --stick-out-m 0.06", 2, {"offset", "60 mm"}, __LINE__);
  refused(command + "h0.csv --offset-m 0.015", 2, {"go together"}, __LINE__);
  refused(command + "h0.csv --estimator h3", 2, {"h1, h2 or hv"}, __LINE__);
  refused(command + "h0.csv --format unv", 2, {"csv, columns and uff58"}, __LINE__);
}

}  // namespace

int main() {
  return in_own_folder("impact", [] {
    good_hits();
    refusals();
  });
}
