// servosense import as a user runs it: the example of its page, answers, maps, refusals, and the
// recorded sets by the commands that the page has.
#include <cmath>
#include <string>
#include <vector>

#include "check.hpp"
#include "program.hpp"

namespace {

using namespace program_test;

std::string part_between(const std::string& text, const std::string& from, const std::string& to) {
  const std::size_t begin = text.find(from);
  if (begin == std::string::npos) return "";
  const std::size_t at = begin + from.size();
  return text.substr(at, text.find(to, at) - at);
}

void the_example_of_the_page() {
  const std::string page = content("docs/import.md");
  fs::create_directories(folder / "tests/data/import");
  put("tests/data/import/lathe.csv", content("tests/data/import/lathe.csv"));
  const Outcome o = run("import tests/data/import/lathe.csv --out lathe.trace");
  that(o.status == 0 && o.err.empty(), o, "works without a question", __LINE__);
  CHECK_TEXT(o.out, part_between(page, "lathe.csv --out lathe.trace\n", "```"));
  const std::vector<std::string> trace = lines(content(folder / "lathe.trace"));
  CHECK(trace.size() == 67);
  if (trace.size() != 67) return;
  CHECK_TEXT(trace[6],
             "t_s,spindle.speed_rad_s,spindle.current_A,x.position_m,x.velocity_m_s,x.current_A");
  // 1500.1/min; 8.39 A; 10.0100 mm; 300 mm/min; 0.61 A.
  CHECK(trace[8].starts_with("0.002,157.09") && trace[8].ends_with(",8.39,0.01001,0.005,0.61"));
  CHECK(trace[20].ends_with(","));     // an empty field
  CHECK(trace[47].ends_with(",nan"));  // ---
}

void questions_and_answers() {
  put("open.csv", "t;Strom X;Drehzahl [1/min]\n0,001;1,5;600\n0,002;1,6;600\n0,003;1,7;600\n");
  const Outcome o = run("import open.csv --out open.trace");
  that(o.status == 3 && one_sentence(o.err), o, "is asked", __LINE__);
  that(contains(o.out, "question: ") && contains(o.out, "--column"), o, "says how", __LINE__);
  CHECK(!fs::exists(folder / "open.trace"));
  const Outcome asked = run("import open.csv --out open.trace --json");
  const Json json(asked.out);
  that(asked.status == 3 && json.ok && json.object, asked, "one object", __LINE__);
  CHECK(json.sizes.at("questions") == 2);
  CHECK_TEXT(json.text("columns.1.to"), "null");
  CHECK_TEXT(json.text("columns.2.to"), "spindle.speed_rad_s");
  CHECK_TEXT(json.text("columns.2.unit"), "1/min");
  CHECK_NEAR(json.number("columns.2.greatest"), 62.83185307179586, 1e-9);
  // All answers, and only then it is written; the map serves the next file.
  run("import open.csv --out open.trace --column t_s=t:s");
  CHECK(!fs::exists(folder / "open.trace"));
  const std::string all = " --column t_s=t:s --column 'x.current_A=Strom X:A'";
  const Outcome preview = run("import open.csv --preview --map next.map" + all);
  that(preview.status == 0, preview, "shows it", __LINE__);
  CHECK(!fs::exists(folder / "next.map"));
  const Outcome done = run("import open.csv --out open.trace --map next.map" + all);
  that(done.status == 0, done, "is written", __LINE__);
  CHECK(contains(content(folder / "next.map"), "made from open.csv\nseparator = semicolon\n"));
  put("second.csv", "t;Drehzahl [1/min];Strom X\n1;600;2,5\n2;600;2,6\n3;600;2,7\n");
  const Outcome second = run("import second.csv --out second.trace --map next.map --json");
  that(second.status == 0, second, "imports by the map", __LINE__);
  CHECK_NEAR(Json(second.out).number("columns.2.greatest"), 2.7, 0);
  // Flags go before the map.
  const Outcome milli = run(
      "import second.csv --out s.trace --map next.map --json --column 'x.current_A=Strom X:mA'");
  CHECK_NEAR(Json(milli.out).number("columns.2.greatest"), 2.7e-3, 1e-18);
  put("third.csv", "Zeit;Drehzahl [1/min];I\n1;600;2,5\n2;600;2,6\n");
  refused("import third.csv --out t.trace --map next.map", 3,
          {"lacks columns that the map names: 't', 'Strom X'"}, __LINE__);
}

// A flag in the file tells which rows are wanted: 0.2 s and more from any that is not.
void rows_where() {
  std::string text = "t_s,x.position_mm,x.current_A,cutting\n";
  std::size_t wanted = 0;
  for (int i = 0; i < 1000; ++i) {
    const bool cutting = (i >= 300 && i < 310) || i == 325 || i >= 900;
    const auto away = [&](int from, int to) { return i < from - 20 || i > to + 20; };
    wanted += !cutting && away(300, 309) && away(325, 325) && away(900, 999);
    text += std::to_string(i) + "e-2," + std::to_string(i) + ",0.5," + (cutting ? "1" : "0") + "\n";
  }
  put("flag.csv", text);
  const std::string command = "import flag.csv --out flag.trace --map flag.map";
  const Outcome o = run(command + " --where cutting=0 --apart 0.2");
  that(o.status == 0, o, "is written", __LINE__);
  that(contains(o.out,
                "taken are " + std::to_string(wanted) + " of 1000 rows: 'cutting' = 0, 0.2 s"),
       o, "counts them", __LINE__);
  const auto kept = [&] {
    std::vector<double> times;
    for (const std::string& line : lines(content(folder / "flag.trace")))
      if (line.find_first_of("0123456789") == 0) times.push_back(std::stod(line));
    return times;
  };
  const std::vector<double> times = kept();
  CHECK(times.size() == wanted);
  for (const double t : times) CHECK((t < 2.795 || (t > 3.455 && t < 8.795)));
  // The map has it, for the next file.
  fs::remove(folder / "flag.trace");
  that(run(command).status == 0 && kept() == times, o, "by the map", __LINE__);
  refused("import flag.csv --out t.trace --where cutting=2", 3, {"has no row with 'cutting' = 2"},
          __LINE__);
  refused("import flag.csv --out t.trace --where cuttings=0", 2, {"'cutting'"}, __LINE__);
  refused("import flag.csv --out t.trace --where cutting", 2, {"cut_signal=0"}, __LINE__);
  refused("import flag.csv --out t.trace --apart 1", 2, {"--where"}, __LINE__);
}

void layouts() {
  // LinuxCNC's halsampler: no heading, no time, a word where samples were lost.
  std::string text;
  for (int i = 0; i < 40; ++i)
    text += std::to_string(i) + " " + std::to_string(10 + 0.5 * i) + " 0.25 \n";
  put("hal.txt", text + "overrun\n");
  const Outcome hal = run("import hal.txt --out hal.trace --json");
  that(hal.status == 3, hal, "is asked", __LINE__);
  const Outcome told =
      run("import hal.txt --out hal.trace --rate 1000 --column x.position_m=#2:mm "
          "--column x.current_A=#3:A");
  that(told.status == 0, told, "works", __LINE__);
  CHECK(contains(content(folder / "hal.trace"), "\n0.039,0.0295,0.25\n"));
  // Thousands or decimals.
  put("mark.csv", "t [s];Kraft Achse X [N]\n1;1,500\n2;2,600\n");
  const Outcome open = run("import mark.csv --out mark.trace");
  that(open.status == 3 && contains(open.out, "--decimal comma"), open, "asks", __LINE__);
  run("import mark.csv --out mark.trace --decimal comma");
  CHECK(contains(content(folder / "mark.trace"), "\n1,1.5\n"));
  run("import mark.csv --out mark.trace --decimal point");
  CHECK(contains(content(folder / "mark.trace"), "\n1,1500\n"));
  // Hundreds of columns that nobody needs.
  std::string wide = "Time [s]";
  for (int i = 0; i < 600; ++i) wide += ",Aux channel " + std::to_string(i) + " [bar]";
  wide += ",X current [A]";
  for (int row = 0; row < 20; ++row) {
    wide += "\n0." + std::to_string(10 + row);
    for (int i = 0; i < 600; ++i) wide += ",1.5";
    wide += ",2.25";
  }
  put("wide.csv", wide);
  const Outcome many = run("import wide.csv --out wide.trace");
  that(many.status == 0, many, "works", __LINE__);
  CHECK(contains(content(folder / "wide.trace"), "\nt_s,x.current_A\n0.1,2.25\n"));
  // Counts of 63 bits stay exact, clocks keep their microseconds.
  put("counts.csv",
      "Uhrzeit;Geber X [inc]\n23:59:59,999999;9007199254740993\n"
      "00:00:00,000124;9007199254740995\n");
  const Outcome counts = run("import counts.csv --out counts.trace");
  that(counts.status == 0, counts, "works", __LINE__);
  CHECK(contains(content(folder / "counts.trace"),
                 "\n0,9007199254740993\n0.000125,9007199254740995\n"));
}

void refusals() {
  put("good.csv", "t [s];Strom X [A]\n1;1.5\n2;1.6\n");
  put("empty.csv", "");
  put("binary.csv", std::string("\x7F"
                                "ELF\0\1\2\3",
                                8));
  refused("import", 2, {"takes one FILE"}, __LINE__);
  refused("import good.csv", 2, {"--out"}, __LINE__);
  refused("import good.csv --out good.csv", 2, {"the same file"}, __LINE__);
  refused("import good.csv --out t.trace --map good.csv", 2, {"the same file"}, __LINE__);
  refused("import good.csv --out t.trace --map t.trace", 2, {"same file"}, __LINE__);
  refused("import absent.csv --out t.trace", 4, {"absent.csv"}, __LINE__);
  refused("import empty.csv --out t.trace --json", 3, {"empty.csv: the file is empty"}, __LINE__);
  refused("import binary.csv --out t.trace", 3, {"binary.csv:1: ", "no text"}, __LINE__);
  refused("import /dev/zero --out t.trace", 2, {"a pipe or device"}, __LINE__);
  refused("import good.csv --out t.trace --column x.curent_A=Strom:A", 2, {"'current_A'"},
          __LINE__);
  refused("import good.csv --out t.trace --column x.current_A=Strim:A", 2, {"'Strom X"}, __LINE__);
  refused("import good.csv --out t.trace --column x.current_A=#2:amp2", 2, {"'Amp"}, __LINE__);
  refused("import good.csv --out t.trace --rate 0", 2, {"--rate"}, __LINE__);
  refused("import good.csv --out t.trace --separator dot", 2, {"semicolon"}, __LINE__);
  CHECK(!fs::exists(folder / "t.trace"));
}

/// The lines of the page that import the recorded sets.
void recorded_sets() {
  const std::string page = part_between(content("docs/import.md"), "## Recorded sets", "## Bad at");
  const std::vector<std::pair<std::string, std::string>> sets = {
      {"umich-cnc-mill", "experiment_01.csv"},
      {"emps", "emps_train.csv"},
      {"nolicence/lugre-direct-drive", "test1_est_j1_05_gan.csv"},
      {"nolicence/saw-chatter-servo", "cut_1.csv"},
      {"turning-torque-force", "segments_1s.csv"}};
  for (const auto& [set, file] : sets) {
    const std::string data = check::outside_data(set);
    if (data.empty()) continue;
    const std::string from = "$ servosense import " + file + " ";
    std::string options = part_between(page, from, "\n$");
    options = options.substr(0, options.find("```"));
    CHECK(!options.empty());
    for (std::size_t at; (at = options.find("\\\n")) != std::string::npos;)
      options.replace(at, 2, " ");
    std::replace(options.begin(), options.end(), '\n', ' ');
    const Outcome o =
        run("import '" + fs::absolute(data + "/" + file).string() + "' " + options + " --quiet");
    that(o.status == 0, o, "imports", __LINE__);
  }
}

}  // namespace

int main() {
  return program_test::in_own_folder("import", [] {
    the_example_of_the_page();
    questions_and_answers();
    rows_where();
    layouts();
    refusals();
    recorded_sets();
  });
}
