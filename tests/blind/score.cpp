#include "score.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

namespace blind {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr std::size_t kLargestClass = 3;  // names in all that a class may have to count as right
const std::string kLine = "time-locked-vibration";

bool covers(const SaidEffect& said, const std::string& name) {
  return said.name == name || (said.others.size() + 1 <= kLargestClass &&
                               std::ranges::find(said.others, name) != said.others.end());
}

/// Two names for one thing: a constant load and Coulomb friction that differs by direction.
bool same_by_definition(const HiddenEffect& truth, const std::string& name) {
  if (truth.name != "constant-load" || name != "asymmetric-friction") return false;
  return true;
}

std::string quoted(const std::string& text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') out += '\\';
    out += c;
  }
  return out + '"';
}

std::string number(double value, const char* format = "%.6g") {
  if (!std::isfinite(value)) return "null";
  char text[40];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

/// The motion that would show one of these, or tell it from its class.
bool says_what_to_record(const Json& report, const std::vector<HiddenEffect>& truth) {
  return std::ranges::any_of(truth, [&](const HiddenEffect& t) {
    for (const Json& e : report["not_testable"].items)
      if (e["name"].text == t.name && !e["would_need"].text.empty()) return true;
    for (const Json& c : report["classes"].items)
      if (!c["split_by"].text.empty() &&
          std::ranges::any_of(c["names"].items, [&](const Json& n) { return n.text == t.name; }))
        return true;
    return false;
  });
}

bool begins(const std::string& text, const char* with) { return text.starts_with(with); }

}  // namespace

bool is_true(const SaidEffect& said, const std::vector<HiddenEffect>& truth) {
  return std::ranges::any_of(truth, [&](const HiddenEffect& t) {
    return covers(said, t.name) || same_by_definition(t, said.name);
  });
}

std::string outcome_of(const std::string& expect, const std::vector<HiddenEffect>& truth,
                       const std::vector<SaidEffect>& said, bool agrees) {
  if (said.empty()) return agrees ? "none" : "unexplained";
  if (expect == "none" || expect == "outside") return "wrong";
  std::size_t found = 0;
  for (const HiddenEffect& t : truth)
    found += std::ranges::any_of(said, [&](const SaidEffect& s) {
      return covers(s, t.name) || same_by_definition(t, s.name);
    });
  std::size_t extra = 0;
  for (const SaidEffect& s : said) extra += !is_true(s, truth);
  const std::string more = extra > 0 ? "+extra" : "";
  if (truth.size() == 2) return found == 2 ? "both" + more : found == 1 ? "one" + more : "wrong";
  if (found == 0) return "wrong";
  return "right" + more;
}

Row score(const Case& c, const Json& report, double seconds) {
  Row row;
  row.name = c.name;
  row.variant = c.variant;
  row.seed = c.seed;
  row.expect = c.truth.expect;
  row.truth = c.truth.effects;
  row.seconds = seconds;
  row.verdict = report.kind == Json::Kind::object ? report["verdict"].text : "failed";
  std::vector<HiddenEffect> background = c.truth.background;
  std::erase_if(background, [](const HiddenEffect& e) { return e.strength < 1; });
  for (const Json& e : report["effects"].items) {
    SaidEffect said{e["name"].text, {}, e["confidence"].number};
    for (const Json& other : e["class"].items) said.others.push_back(other.text);
    // Of the background that shows: true, but not what was asked.
    if (is_true(said, background) && !is_true(said, c.truth.effects)) continue;
    row.said.push_back(std::move(said));
  }
  row.outcome = row.verdict == "failed"
                    ? "failed"
                    : outcome_of(row.expect, row.truth, row.said, row.verdict == "agrees");

  row.motion = says_what_to_record(report, c.truth.effects);

  const double before = report["gap_before"].number;
  const double after = report["gap_after"].number;
  const double noise = report["noise_floor"].number;
  const auto beyond = [&](double gap) { return std::max(0.0, gap * gap - noise * noise); };
  row.explained = beyond(before) > 0 ? 1 - beyond(after) / beyond(before) : kNaN;
  // Drives: their gap and ours differ by filter and view; what each lost of its own is comparable.
  // Milling: both are of the raw forces, and what recalibration closed ahead of any name is not
  // asked for again.
  const bool same_view = c.name.find("milling/") != std::string::npos;
  const double could =
      same_view ? 1 - c.truth.gap_oracle / before : 1 - c.truth.gap_oracle / c.truth.gap_before;
  row.closure = before > 0 && could > 0.05 ? (1 - after / before) / could : kNaN;

  for (const HiddenEffect& t : c.truth.effects)
    for (const Json& e : report["effects"].items) {
      if (e["name"].text != t.name) continue;
      const Json& said = e["parameters"];
      const auto values = [&](const std::string& key) {
        std::vector<double> all;
        for (const Json& item : said[key].items) all.push_back(item.number);
        if (said[key].kind == Json::Kind::number) all.push_back(said[key].number);
        return all;
      };
      // Of a list of lines, the one with the order that is meant.
      std::size_t which = 0;
      for (const auto& [key, value] : t.parameters) {
        if (key != "order") continue;
        const std::vector<double> orders = values(key);
        for (std::size_t i = 0; i < orders.size(); ++i)
          if (std::abs(orders[i] - value) < std::abs(orders[which] - value)) which = i;
      }
      for (const auto& [key, value] : t.parameters) {
        const std::vector<double> all = values(key);
        if (which < all.size() && value != 0)
          row.parameter_errors.emplace_back(key, std::abs(all[which] - value) / std::abs(value));
      }
    }
  return row;
}

std::string row_json(const Row& row) {
  std::string text = "{\"case\": " + quoted(row.name) + ", \"seed\": " + std::to_string(row.seed) +
                     ", \"variant\": " + quoted(row.variant) +
                     ", \"expect\": " + quoted(row.expect) + ", \"truth\": [";
  const char* comma = "";
  for (const HiddenEffect& t : row.truth) {
    text += comma + ("{\"name\": " + quoted(t.name)) + ", \"strength\": " + number(t.strength) +
            ", \"visibility\": " + number(t.visibility) + "}";
    comma = ", ";
  }
  text += "], \"verdict\": " + quoted(row.verdict) + ", \"said\": [";
  comma = "";
  for (const SaidEffect& s : row.said) {
    text += comma + ("{\"name\": " + quoted(s.name)) + ", \"confidence\": " + number(s.confidence) +
            ", \"class\": [";
    for (std::size_t i = 0; i < s.others.size(); ++i) text += (i ? ", " : "") + quoted(s.others[i]);
    text += "]}";
    comma = ", ";
  }
  text += "], \"outcome\": " + quoted(row.outcome) + ", \"explained\": " + number(row.explained) +
          ", \"closure\": " + number(row.closure) + ", \"parameter_errors\": {";
  comma = "";
  for (const auto& [key, error] : row.parameter_errors) {
    text += comma + quoted(key) + ": " + number(error);
    comma = ", ";
  }
  text += "}, \"seconds\": " + number(row.seconds, "%.2f") + ", \"comparator\": [";
  for (std::size_t i = 0; i < row.comparator.size(); ++i)
    text += (i ? ", " : "") + quoted(row.comparator[i]);
  return text + "], \"comparator_outcome\": " + quoted(row.comparator_outcome) +
         ", \"motion\": " + (row.motion ? "1" : "0") + "}";
}

Row row_of(const Json& json) {
  Row row;
  row.name = json["case"].text;
  row.variant = json["variant"].text;
  row.seed = static_cast<std::uint64_t>(json["seed"].number);
  row.expect = json["expect"].text;
  for (const Json& t : json["truth"].items)
    row.truth.push_back({t["name"].text, {}, t["strength"].number, t["visibility"].number});
  row.verdict = json["verdict"].text;
  for (const Json& s : json["said"].items) {
    SaidEffect said{s["name"].text, {}, s["confidence"].number};
    for (const Json& other : s["class"].items) said.others.push_back(other.text);
    row.said.push_back(std::move(said));
  }
  row.outcome = json["outcome"].text;
  row.explained = json["explained"].kind == Json::Kind::number ? json["explained"].number : kNaN;
  row.closure = json["closure"].kind == Json::Kind::number ? json["closure"].number : kNaN;
  for (const auto& [key, value] : json["parameter_errors"].members)
    row.parameter_errors.emplace_back(key, value.number);
  row.seconds = json["seconds"].number;
  for (const Json& name : json["comparator"].items) row.comparator.push_back(name.text);
  row.comparator_outcome = json["comparator_outcome"].text;
  row.motion = json["motion"].number != 0;
  return row;
}

bool acceptable(const std::vector<Row>& rows, std::string& why) {
  std::size_t strong = 0, found = 0, wrong = 0;
  for (const Row& row : rows) {
    const std::string what = row.name + ", seed " + std::to_string(row.seed);
    if (row.outcome == "failed") why += what + ": no report\n";
    if (row.outcome == "wrong" || row.outcome.ends_with("+extra")) {
      ++wrong;
      why += what + ": wrong name " + row.said.front().name + '\n';
    }
    if (row.expect == "name" && row.truth.size() == 1 && row.truth.front().strength >= 4) {
      ++strong;
      found += begins(row.outcome, "right");
      if (!begins(row.outcome, "right")) why += what + ": missed\n";
    }
  }
  if (rows.empty()) why += "no case was run\n";
  // A guard against going backwards, not the goal (99 %): on so few cases one may be missed.
  const bool good = !rows.empty() && wrong == 0 && 5 * found >= 4 * strong &&
                    std::ranges::none_of(rows, [](const Row& r) { return r.outcome == "failed"; });
  if (good) why.clear();
  return good;
}

}  // namespace blind
