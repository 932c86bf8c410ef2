// Exports of random layout, whose true map and values are known, through `servosense import`: what
// the program decides is right, and what it cannot decide it asks - in every one.
//
//   test_cli import_layouts FROM TO     exports of these seeds, each that was asked is printed
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include "check.hpp"
#include "import_exports.hpp"
#include "program.hpp"

namespace {

using namespace program_test;

using namespace import_exports;

// ---- the score ----------------------------------------------------------------------------------

struct Score {
  std::size_t exports = 0, imported = 0, asked = 0, wrong = 0, plain_asked = 0, plain = 0;
};

/// Sentence on the first difference between a trace and the truth; empty: none.
std::string difference(const Export& e, const std::string& trace) {
  std::vector<std::string> names;
  std::size_t row = 0;
  double first_s = 0;
  for (const std::string& line : lines(trace)) {
    if (line.starts_with('#')) continue;
    std::vector<std::string> fields(1);
    for (const char c : line)
      if (c == ',')
        fields.emplace_back();
      else if (c != '\r')
        fields.back() += c;
    if (names.empty()) {
      names = fields;
      for (const Column& c : e.columns)
        if (!c.to.empty() && std::find(names.begin(), names.end(), c.to) == names.end())
          return c.to + " is missing";
      continue;
    }
    if (row >= e.t_s.size()) return "more rows than there are";
    const double t = std::strtod(fields[0].c_str(), nullptr);
    if (row == 0) first_s = t;
    if (std::abs(t - first_s - e.t_s[row]) > 2 * e.t_resolution_s + 1e-9)
      return "time of row " + std::to_string(row);
    for (std::size_t k = 1; k < names.size(); ++k) {
      const auto c = std::find_if(e.columns.begin(), e.columns.end(),
                                  [&](const Column& column) { return column.to == names[k]; });
      if (c == e.columns.end()) return names[k] + " is none of the file's";
      const bool missing = fields[k].empty() || fields[k] == "nan";
      if (missing != std::isnan(c->si[row])) return names[k] + " has or lacks a value";
      const double step = 0.51 * c->unit.si * std::pow(10.0, -c->unit.digits);
      const double value = std::strtod(fields[k].c_str(), nullptr);
      if (!missing && std::abs(value - c->si[row]) > step + 1e-9 * std::abs(value))
        return names[k] + " of row " + std::to_string(row) + " is " + fields[k];
    }
    ++row;
  }
  return row == e.t_s.size() ? "" : "rows are missing";
}

/// Whether what was decided, in spite of open questions, is right.
std::string wrong_column(const Export& e, const Json& json) {
  for (std::size_t i = 0; i <= e.columns.size(); ++i) {
    if (i == e.time_at) continue;
    const Column& c = e.columns[i < e.time_at ? i : i - 1];
    const std::string to = json.text("columns." + std::to_string(i) + ".to");
    if (to == "null" || to == c.to) continue;
    return "'" + c.name + "' became " + to;
  }
  const std::string time = json.text("columns." + std::to_string(e.time_at) + ".to");
  return time == "t_s" || time == "null" ? "" : "the time became " + time;
}

std::string all_answers(const Export& e) {
  std::string text = " --only";
  for (std::size_t i = 0; i <= e.columns.size(); ++i) {
    const std::string place = "#" + std::to_string(i + 1);
    if (i == e.time_at) {
      if (e.time_stands == 0)
        text += " --column 't_s=" + place + (e.time_unit.empty() ? "" : ":" + e.time_unit) + "'";
      continue;
    }
    const Column& c = e.columns[i < e.time_at ? i : i - 1];
    if (!c.to.empty()) text += " --column '" + c.to + "=" + place + ":" + c.unit.text + "'";
  }
  if (e.time_stands > 0) text += " --rate " + std::to_string(std::lround(1 / e.t_s[1]));
  return text;
}

void score(std::uint64_t seed, bool print, Score& all) {
  const Export e = make_export(seed);
  const std::string file = "s" + std::to_string(seed) + ".csv";
  put(file, e.text);
  ++all.exports;
  const Outcome o = run("import " + file + " --out t.trace --json");
  const Json json(o.out);
  std::string fault;
  if ((o.status != 0 && o.status != 3) || !json.ok || !json.sizes.contains("columns"))
    fault = "status " + std::to_string(o.status) + " " + o.err;
  else
    fault = wrong_column(e, json);
  if (!e.ambiguous) ++all.plain;
  if (fault.empty() && o.status == 0) {
    fault = difference(e, content(folder / "t.trace"));
    ++all.imported;
  } else if (fault.empty()) {
    ++all.asked;
    if (!e.ambiguous) ++all.plain_asked;
    if (print) {
      std::printf("seed %llu asked (%s):\n", static_cast<unsigned long long>(seed), e.kind.c_str());
      for (std::size_t i = 0; i < json.sizes.at("questions"); ++i)
        std::printf("    %s\n", json.text("questions." + std::to_string(i)).c_str());
    }
  }
  // With every answer given, everything is imported.
  if (fault.empty() && o.status == 3) {
    fs::remove(folder / "t.trace");
    const Outcome answered = run("import " + file + " --out t.trace" + all_answers(e));
    fault = answered.status == 0 ? difference(e, content(folder / "t.trace"))
                                 : "with all answers: " + answered.err + answered.out;
  }
  if (!fault.empty()) {
    ++all.wrong;
    std::printf("seed %llu (%s): %s\n", static_cast<unsigned long long>(seed), e.kind.c_str(),
                fault.c_str());
  }
  if (fault.empty()) fs::remove(folder / file);
}

// Rules were made on 1 to 1600; these were scored once, afterwards.
constexpr std::uint64_t kFrom = 70001, kTo = 70200;

}  // namespace

int main(int argc, char** argv) {
  return program_test::in_own_folder("import_layouts", [&] {
    const bool asked_for = argc > 2;
    const std::uint64_t from = asked_for ? std::strtoull(argv[1], nullptr, 10) : kFrom;
    const std::uint64_t to = asked_for ? std::strtoull(argv[2], nullptr, 10) : kTo;
    Score all;
    for (std::uint64_t seed = from; seed <= to; ++seed) score(seed, asked_for, all);
    check::figure("exports", static_cast<double>(all.exports));
    check::figure("imported without a question", static_cast<double>(all.imported));
    check::figure("asked", static_cast<double>(all.asked));
    check::figure("of those that can be decided", static_cast<double>(all.plain));
    check::figure("asked nevertheless", static_cast<double>(all.plain_asked));
    CHECK(all.wrong == 0);
    CHECK(all.imported > all.exports / 3 && all.asked > all.exports / 10);
    // Asking is always safe; one in fifty of what can be decided is the most that is useful.
    CHECK(all.plain_asked * 50 <= all.plain);
  });
}
