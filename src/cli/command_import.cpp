// servosense import: tables of other programs to traces.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <iostream>

#include "commands.hpp"
#include "console.hpp"
#include "output_check.hpp"
#include "servosense/io/file_identity.hpp"
#include "servosense/io/import_plan.hpp"
#include "servosense/io/json.hpp"
#include "servosense/io/output_file.hpp"
#include "servosense/io/text.hpp"
#include "servosense/io/trace.hpp"
#include "servosense/io/unit_name.hpp"
#include "servosense/io/write_file.hpp"

namespace servosense::cli {
namespace {

/// What a column becomes, in words.
std::string target_text(const ImportColumn& column) {
  if (column.is_time) return "t_s";
  return column.signal ? column_name(*column.signal) : "-";
}

std::string trace_unit(const ImportColumn& column) {
  if (column.is_time) return "s";
  return column.signal ? std::string(unit_of(column.signal->quantity)) : "";
}

/// "-6 .. 6 m/s"
std::string range_text(double least, double greatest, const std::string& unit) {
  if (!std::isfinite(least)) return "-";
  return printed(least, 5) + " .. " + printed(greatest, 5) + (unit.empty() ? "" : " " + unit);
}

/// With blanks up to a number of characters.
std::string padded(std::string text, std::size_t width) {
  const auto characters = static_cast<std::size_t>(
      std::count_if(text.begin(), text.end(), [](char c) { return (c & 0xC0) != 0x80; }));
  if (characters < width) text.append(width - characters, ' ');
  return text;
}

void print_columns(const ImportPlan& plan) {
  const auto row = [](const std::string& number, const std::string& heading, const std::string& to,
                      const std::string& unit, const std::string& range,
                      const std::string& machines, const std::string& missing,
                      const std::string& first) {
    say("  %4s  %s %s %s %s %s %s %s\n", number.c_str(), padded(heading, 28).c_str(),
        padded(to, 24).c_str(), padded(unit, 8).c_str(), padded(range, 28).c_str(),
        padded(machines, 20).c_str(), padded(missing, 8).c_str(), first.c_str());
  };
  row("", "column", "becomes", "unit", "least .. greatest", "what machines do", "missing",
      "first values");
  std::size_t left_out = 0;
  constexpr std::size_t kShown = 40;  // of those that are left out
  for (const ImportColumn& c : plan.columns) {
    if (!c.signal && !c.is_time && !c.is_open && ++left_out > kShown) continue;
    std::string machines = "-";
    if (c.signal) {
      const QuantityRange range = range_of(c.signal->quantity);
      machines = range_text(range.least, range.greatest, "");
    }
    std::string first;
    for (const std::string& field : c.first) first += (first.empty() ? "" : " | ") + field;
    char missing[16];
    std::snprintf(missing, sizeof missing, "%.3g %%", 100 * c.missing_share);
    row("#" + std::to_string(c.number), printable(c.heading, 28), c.is_open ? "?" : target_text(c),
        c.unit.empty() ? "-" : printable(c.unit, 10),
        range_text(c.least, c.greatest, trace_unit(c)), machines, missing, first);
    if (!c.reason.empty()) say("        %s\n", c.reason.c_str());
  }
  if (left_out > kShown) say("  and %zu more that are left out\n", left_out - kShown);
}

void print_plan(const TableFile& file, const ImportPlan& plan) {
  const TableLayout& layout = file.layout();
  say("%s: %s, separated by %s, decimal %s, rows from line %zu: %zu rows, %zu columns\n",
      file.name().c_str(), layout.encoding.c_str(), separator_name(layout.separator).c_str(),
      layout.mark == DecimalMark::point ? "point" : "comma", layout.first_line, plan.rows,
      plan.columns.size());
  for (std::size_t i = 0; i < layout.titles.size() && i < 3; ++i)
    say("  above the heading: %s\n", printable(layout.titles[i], 100).c_str());
  if (std::isfinite(plan.period_s) && plan.period_s > 0)
    say("  %.6g rows a second\n", 1 / plan.period_s);
  print_columns(plan);
  for (const std::string& remark : plan.remarks) say("remark: %s\n", remark.c_str());
  for (const std::string& question : plan.questions) say("question: %s\n", question.c_str());
}

void print_json(const std::string& file, const TableLayout& layout, const ImportPlan& plan,
                const std::string& out, bool written) {
  JsonWriter json(std::cout, 2);
  json.begin_object();
  json.member("file", file);
  json.key("out");
  written ? json.value(out) : json.value(nullptr);
  json.member("encoding", layout.encoding);
  json.member("separator", separator_name(layout.separator));
  json.member("decimal", layout.mark == DecimalMark::point ? "point" : "comma");
  json.member("first_line", layout.first_line);
  json.member("rows", plan.rows);
  json.member("sample_rate_hz", plan.period_s > 0 ? 1 / plan.period_s : std::nan(""));
  json.key("start");
  plan.time.from_first ? json.value(plan.time.origin) : json.value(nullptr);
  json.objects("columns", plan.columns, [&](const ImportColumn& c) {
    json.member("number", c.number);
    json.member("from", c.heading);
    json.key("to");
    c.is_time || c.signal ? json.value(target_text(c)) : json.value(nullptr);
    json.key("unit");
    c.unit.empty() ? json.value(nullptr) : json.value(c.unit);
    json.member("least", c.least);
    json.member("greatest", c.greatest);
    json.member("missing_share", c.missing_share);
    json.values("first", c.first);
    json.member("reason", c.reason);
    const QuantityRange range = c.signal ? range_of(c.signal->quantity) : QuantityRange{};
    json.member("machines_least", c.signal ? range.least : std::nan(""));
    json.member("machines_greatest", c.signal ? range.greatest : std::nan(""));
  });
  json.values("questions", plan.questions);
  json.values("remarks", plan.remarks);
  json.end_object();
  std::cout << '\n';
}

Expected<ImportMap> answers_of(const Arguments& arguments) {
  ImportMap flags;
  for (const std::string& text : arguments.all("--column")) {
    auto entry = import_entry_from(text);
    if (!entry) return usage_error("--column: " + entry.error().sentence);
    flags.entries.push_back(std::move(*entry));
  }
  if (const auto text = arguments.value("--separator")) {
    const auto separator = separator_from(*text);
    if (!separator) return separator.error();
    flags.separator = *separator;
  }
  if (const auto text = arguments.value("--decimal")) {
    const auto mark = decimal_mark_from(*text);
    if (!mark) return mark.error();
    flags.mark = *mark;
  }
  const auto rate = arguments.within("--rate", 0.01, 1e6, " rows a second");
  if (!rate) return rate.error();
  flags.rate_hz = *rate;
  flags.only = arguments.has("--only");
  if (const auto text = arguments.value("--where")) {
    auto where = import_where_from(*text);
    if (!where) return usage_error("--where: " + where.error().sentence);
    flags.where = std::move(*where);
  }
  const auto apart = arguments.within("--apart", 0, 3600, " s");
  if (!apart) return apart.error();
  if (*apart && !flags.where)
    return usage_error(
        "--apart is the distance from rows that --where does not take; say --where, too");
  if (*apart) flags.where->apart_s = **apart;
  const auto path = arguments.value("--map");
  if (!path || !std::filesystem::exists(*path)) return flags;
  auto map = read_import_map(*path);
  if (!map) return map.error();
  return overridden(std::move(*map), flags);
}

/// The files of the command, before anything is read.
Expected<Done> check_files(const Arguments& arguments) {
  if (arguments.operands().size() != 1)
    return usage_error("servosense import takes one FILE; see 'servosense import --help'");
  if (!arguments.has("--out") && !arguments.has("--preview"))
    return usage_error(
        "servosense import needs --out TRACE, or --preview; see 'servosense import --help'");
  const std::string& file = arguments.operands()[0];
  if (auto done = check_rereadable(file); !done) return done.error();
  const auto map = arguments.value("--map");
  if (!map) return Done{};
  if (const auto same = file_identity(*map); same && same == file_identity(file))
    return usage_error("--map " + printable(*map, 400) + " and " + printable(file, 400) +
                       " are the same file; give each a name of its own");
  if (!std::filesystem::exists(*map)) return check_writable(*map);
  return Done{};
}

int run_import(const Arguments& arguments) {
  if (auto done = check_files(arguments); !done) return fail(done.error());
  const std::string& path = arguments.operands()[0];
  const auto answers = answers_of(arguments);
  if (!answers) return fail(answers.error());
  auto file = TableFile::open(path, {answers->separator, answers->mark});
  if (!file) return fail(file.error());
  const auto plan = [&] {
    Progress progress("reading " + path, arguments.quiet());
    return plan_import(*file, *answers, [&](double share) { progress.show(share); });
  }();
  if (!plan) return fail(plan.error());
  const bool preview = arguments.has("--preview");
  const std::string out = arguments.value("--out").value_or("");
  const bool writes = !preview && plan->questions.empty();
  if (writes) {
    Progress progress("writing " + out, arguments.quiet());
    const auto rows = write_import(*file, *plan, out, [&](double share) { progress.show(share); });
    if (!rows) return fail(rows.error());
    const auto map = arguments.value("--map");
    if (map && !std::filesystem::exists(*map))
      if (auto done = write_file(*map, import_map_text(plan->map, path)); !done)
        return fail(done.error());
  }
  if (arguments.json())
    print_json(path, file->layout(), *plan, out, writes);
  else
    print_plan(*file, *plan);
  if (plan->questions.empty()) return 0;
  const std::size_t open = plan->questions.size();
  return complain(data_error(printable(path, 400) + ": " + std::to_string(open) +
                             (open == 1 ? " question is" : " questions are") +
                             " open, so nothing was written; answer with the options that stand "
                             "beside " +
                             (open == 1 ? "it" : "them")));
}

}  // namespace

Program import_program() {
  return {
      {"import",
       "tables of controls, oscilloscopes and spreadsheets to traces",
       {{"--out", "TRACE", "trace to write", false, FileUse::output},
        {"--column",
         "NEW=OLD:UNIT",
         "trace column NEW is made of the file's OLD; '-=OLD' leaves OLD out",
         false,
         FileUse::none,
         {},
         true},
        {"--only", "", "leave out every column that no --column names, but for the time"},
        {"--rate", "HZ", "rows a second, for a table without time"},
        {"--where", "OLD=VALUE", "take only rows in which a column has this value: cut_signal=0"},
        {"--apart", "S", "and which are S seconds and more away from any other row"},
        {"--map", "FILE", "answers of an earlier import; written when it is not there yet", false,
         FileUse::input},
        {"--separator", "WORD", "semicolon, comma, tab, blank, bar or none, if not as found"},
        {"--decimal", "WORD", "point or comma, if not as found"},
        {"--preview", "", "show what would be written, and write nothing"}},
       "FILE",
       "OLD is the heading as it stands in the file, with or without its unit, or #3 for the\n"
       "third column. UNIT: s ms us, rpm 1/min deg/s rad/s, deg rad, m mm um,\n"
       "m/min mm/min mm/s m/s, A mA, Nm N V W kW %. The time is t_s=OLD:UNIT.\n"
       "Whatever cannot be decided is a question; then nothing is written and the status is 3.\n"},
      run_import};
}

}  // namespace servosense::cli
