#include "summary.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <set>

namespace blind {
namespace {

using std::to_string;

constexpr std::array kSweepBins{0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 8.0, 16.0, 64.0};
constexpr std::array kConfidenceBins{0.0, 0.8, 0.9, 0.95, 0.98, 1.0};
/// Effects with a memory or a resonance, which a record shows less sharply.
const std::set<std::string> kCoarse{"presliding-hysteresis", "backlash", "flexible-coupling",
                                    "sensor-resonance", "extra-mode"};

std::string domain_of(const Row& row) { return row.name.substr(0, row.name.find('/')); }

std::string cell_of(const Row& row) {
  const auto first = row.name.find('/');
  return row.name.substr(0, row.name.find('/', first + 1));
}

bool is_right(const std::string& outcome) {
  return outcome.starts_with("right") || outcome.starts_with("both");
}

bool has_extra(const std::string& outcome) { return outcome.ends_with("+extra"); }

std::string text_of(double value, const char* format = "%.6g") {
  if (!std::isfinite(value)) return "-";
  char text[40];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

std::string percent(double share) { return text_of(100 * share, "%.1f"); }

std::string json_number(double value) { return std::isfinite(value) ? text_of(value) : "null"; }

std::string said_of(const Row& row) {
  if (row.said.empty()) return row.outcome;
  std::string names;
  for (const SaidEffect& s : row.said) names += (names.empty() ? "" : " + ") + s.name;
  return names;
}

std::string hidden_in(const Row& row) {
  std::string text = "nothing";
  for (std::size_t i = 0; i < row.truth.size(); ++i)
    text = (i > 0 ? text + " + " : "") + row.truth[i].name + " (" +
           text_of(row.truth[i].strength, "%.1f") + ")";
  return text;
}

std::string described(const Row& row) {
  std::string text = row.name + " " + to_string(row.seed) + ": " + said_of(row);
  if (!row.truth.empty()) text += " for " + hidden_in(row);
  return text;
}

using Truths = std::array<std::map<std::string, std::size_t>, kStrengthClasses.size()>;

void count_figures(const std::vector<const Row*>& rows, Summary& s) {
  GoalFigure right[3] = {{"right name, one effect, strength >= 4", ">= 99 %", {}, {}},
                         {"the same, strength 2 to 4", ">= 95 %", {}, {}},
                         {"the same, strength 1 to 2", ">= 75 %", {}, {}}};
  GoalFigure wrong{"wrong name, an effect hidden, any strength", "<= 1 %", {}, {}};
  GoalFigure second{"a wrong name beside the right one, one effect", "<= 2 %", {}, {}};
  GoalFigure null{"a name where nothing is hidden", "<= 1 %", {}, {}};
  GoalFigure outside{"a wrong name for what is not in the catalogue", "<= 3 %", {}, {}};
  GoalFigure both{"both of two effects", ">= 92 %", {}, {}};
  GoalFigure strong{"the same, both of strength >= 4", "", {}, {}};
  GoalFigure third{"a third, wrong name", "<= 2 %", {}, {}};
  GoalFigure closed{"share of the oracle's gap closed, median", ">= 0.95", {}, {}, 0.5};
  GoalFigure least{"the same, lowest tenth", ">= 0.8", {}, {}, 0.1};
  GoalFigure sharp{"parameter error, strength >= 4, median", "<= 0.02", {}, {}, 0.5};
  GoalFigure coarse{"the same, hysteresis, play, resonances", "<= 0.15", {}, {}, 0.5};
  GoalFigure poor{"poor motion: right, or no name and what to record", "100 %", {}, {}};
  GoalFigure plain_right{"plain library: right, strength >= 4", "", {}, {}};
  GoalFigure plain_null{"plain library: a name where nothing is hidden", "", {}, {}};
  for (const Row* row : rows) {
    const std::string& o = row->outcome;
    if (row->expect == "none") {
      null.rate.add(o == "wrong");
      if (!row->comparator_outcome.empty()) plain_null.rate.add(row->comparator_outcome == "wrong");
    } else if (row->expect == "outside" || row->expect == "line") {
      outside.rate.add(o == "wrong" || has_extra(o));
    } else if (row->expect == "class") {
      poor.rate.add(is_right(o) || (o != "wrong" && o != "failed" && row->motion));
    } else if (row->truth.size() == 2) {
      wrong.rate.add(o == "wrong");
      both.rate.add(is_right(o));
      third.rate.add(has_extra(o));
      if (std::min(row->truth[0].strength, row->truth[1].strength) >= 4)
        strong.rate.add(is_right(o));
    } else {
      const HiddenEffect& t = row->truth.front();
      const std::size_t c = class_of(t.strength);
      wrong.rate.add(o == "wrong");
      second.rate.add(has_extra(o));
      if (c < 3) right[c].rate.add(is_right(o));
      if (c != 0) continue;
      if (!row->comparator_outcome.empty()) plain_right.rate.add(is_right(row->comparator_outcome));
      if (!is_right(o)) continue;
      if (std::isfinite(row->closure)) closed.values.push_back(row->closure);
      for (const auto& [key, error] : row->parameter_errors) {
        s.parameter_errors[domain_of(*row) + " " + t.name + " `" + key + "`"].push_back(error);
        (kCoarse.contains(t.name) ? coarse : sharp).values.push_back(error);
      }
    }
  }
  least.values = s.closures = closed.values;
  s.goals.assign(std::begin(right), std::end(right));
  s.goals.insert(s.goals.end(), {wrong, second, null, outside, both, strong, third, closed, least,
                                 sharp, coarse, poor, plain_right, plain_null});
}

void count_calibration(const std::vector<const Row*>& rows, Summary& s) {
  for (std::size_t i = 0; i + 1 < kConfidenceBins.size(); ++i)
    s.calibration.push_back({kConfidenceBins[i], kConfidenceBins[i + 1], 0, {}});
  for (const Row* row : rows)
    for (const SaidEffect& said : row->said) {
      const bool right = is_true(said, row->truth);
      auto bin = std::ranges::find_if(s.calibration,
                                      [&](const Calibration& c) { return said.confidence < c.to; });
      if (bin == s.calibration.end()) --bin;
      bin->confidence += said.confidence;
      bin->right.add(right);
      s.brier += (said.confidence - right) * (said.confidence - right);
      ++s.names;
    }
  s.brier = s.names > 0 ? s.brier / static_cast<double>(s.names) : quantile({}, 0);
}

void count_confusion(const Row& row, Summary& s) {
  std::string said = row.said.empty() ? row.outcome : row.said.front().name;
  if (row.truth.empty()) {
    ++s.nameless[row.name][0][said];
    return;
  }
  if (row.truth.size() == 2) {
    const double weaker = std::min(row.truth[0].strength, row.truth[1].strength);
    ++s.nameless["two effects, by the weaker"][class_of(weaker)][row.outcome];
    return;
  }
  const HiddenEffect& t = row.truth.front();
  if (row.outcome.starts_with("right")) {
    // The name that is right need not be the first.
    said = t.name;
    if (has_extra(row.outcome))
      for (const SaidEffect& other : row.said)
        if (!is_true(other, row.truth)) said += " + " + other.name;
  }
  if (row.expect == "name")
    ++s.confusion[t.name][class_of(t.strength)][said];
  else
    ++s.nameless[row.expect == "class" ? cell_of(row) : row.name][class_of(t.strength)][said];
}

/// Names must stay when units are scaled, the axis is reversed, rows left out, the zero moved.
GoalFigure variants(const std::vector<Row>& rows, Summary& s) {
  GoalFigure same{"same names when scaled, reversed, decimated, moved", "100 %", {}, {}};
  std::map<std::pair<std::string, std::uint64_t>, const Row*> plain;
  for (const Row& row : rows)
    if (row.variant == "plain") plain[{row.name, row.seed}] = &row;
  const auto names_of = [](const Row& row) {
    std::set<std::string> names;
    for (const SaidEffect& said : row.said) names.insert(said.name);
    return names;
  };
  for (const Row& row : rows) {
    const auto original = plain.find({row.name, row.seed});
    if (row.variant == "plain" || original == plain.end()) continue;
    same.rate.add(names_of(row) == names_of(*original->second));
    if (names_of(row) != names_of(*original->second))
      s.missed.push_back(described(row) + ", " + row.variant +
                         "; plain: " + said_of(*original->second));
  }
  return same;
}

std::string goal_row(const GoalFigure& g) {
  const bool is_rate = g.q < 0;
  const std::size_t of = is_rate ? g.rate.of : g.values.size();
  std::string text = "| " + g.title + " | " + g.goal + " | ";
  if (of == 0) return text + "- | | 0 |\n";
  const Interval i = is_rate ? g.rate.interval() : quantile_interval(g.values, g.q);
  if (is_rate)
    return text + percent(g.rate.share()) + " % | " + percent(i.low) + " to " + percent(i.high) +
           " % | " + to_string(g.rate.hits) + " of " + to_string(of) + " |\n";
  return text + text_of(quantile(g.values, g.q), "%.3f") + " | " + text_of(i.low, "%.3f") + " to " +
         text_of(i.high, "%.3f") + " | " + to_string(of) + " |\n";
}

std::string outcome_cells(const Outcomes& o) {
  return to_string(o.of) + " | " + to_string(o.right) + " | " + to_string(o.one) + " | " +
         to_string(o.none) + " | " + to_string(o.unexplained + o.refused) + " | " +
         to_string(o.wrong) + " | " + to_string(o.extra) + " | " + to_string(o.failed) + " |\n";
}

std::string outcome_json(const Outcomes& o) {
  return "{\"cases\": " + to_string(o.of) + ", \"right\": " + to_string(o.right) +
         ", \"one_of_two\": " + to_string(o.one) + ", \"wrong\": " + to_string(o.wrong) +
         ", \"none\": " + to_string(o.none) + ", \"unexplained\": " + to_string(o.unexplained) +
         ", \"extra\": " + to_string(o.extra) + ", \"refused\": " + to_string(o.refused) +
         ", \"failed\": " + to_string(o.failed) + "}";
}

const char* const kOutcomeHeader =
    " | cases | right | one of two | `agrees` | unexplained, refused | wrong | with a wrong one "
    "more | no report |\n|---|---|---|---|---|---|---|---|---|\n";

void confusion_table(std::string& text, const char* title,
                     const std::map<std::string, Truths>& counts) {
  text += std::string("\n| ") + title + " |";
  for (const StrengthClass& c : kStrengthClasses) text += std::string(" ") + c.title + " |";
  text += "\n|---|---|---|---|---|\n";
  for (const auto& counted : counts) {
    const std::string& truth = counted.first;
    text += "| " + truth + " |";
    for (const auto& said : counted.second) {
      std::string cell;
      const auto put = [&](const std::string& name, std::size_t n) {
        cell += (cell.empty() ? "" : ", ") + to_string(n) + " " + (name == truth ? "right" : name);
      };
      if (const auto right = said.find(truth); right != said.end()) put(truth, right->second);
      for (const auto& [name, n] : said)
        if (name != truth) put(name, n);
      text += " " + cell + " |";
    }
    text += '\n';
  }
}

void confusion_json(std::string& json, const char* key,
                    const std::map<std::string, Truths>& counts) {
  json += std::string(",\n \"") + key + "\": {";
  const char* comma = "";
  for (const auto& [truth, classes] : counts) {
    json += std::string(comma) + "\n  \"" + truth + "\": {";
    comma = ",";
    const char* between = "";
    for (std::size_t c = 0; c < classes.size(); ++c) {
      json += std::string(between) + "\"" + kStrengthClasses[c].title + "\": {";
      between = ", ";
      const char* inner = "";
      for (const auto& [name, n] : classes[c]) {
        json += inner + ("\"" + name) + "\": " + to_string(n);
        inner = ", ";
      }
      json += "}";
    }
    json += "}";
  }
  json += "}";
}

void list(std::string& text, const char* title, const std::vector<std::string>& items) {
  if (items.empty()) return;
  text += std::string("\n") + title + "\n\n";
  for (const std::string& item : items) text += "* " + item + '\n';
}

}  // namespace

void Outcomes::add(const std::string& outcome) {
  ++of;
  right += is_right(outcome);
  one += outcome.starts_with("one");
  wrong += outcome == "wrong";
  none += outcome == "none";
  unexplained += outcome == "unexplained";
  extra += has_extra(outcome);
  refused += outcome == "refused";
  failed += outcome == "failed";
}

std::size_t class_of(double strength) {
  std::size_t c = 0;
  while (c + 1 < kStrengthClasses.size() && !(strength >= kStrengthClasses[c].from)) ++c;
  return c;
}

Summary summarise(const std::vector<Row>& all) {
  Summary s;
  std::vector<const Row*> rows;
  for (const Row& row : all)
    if (row.variant == "plain") rows.push_back(&row);
  // Rows come in the order in which their cases were done.
  std::ranges::sort(rows, [](const Row* a, const Row* b) {
    return std::pair{a->name, a->seed} < std::pair{b->name, b->seed};
  });
  for (const double bin : kSweepBins) s.sweep.push_back({bin, {}});
  count_figures(rows, s);
  count_calibration(rows, s);
  for (const Row* row : rows) {
    s.cells[cell_of(*row)].add(row->outcome);
    if (!row->comparator_outcome.empty()) s.comparator[cell_of(*row)].add(row->comparator_outcome);
    s.seconds.push_back(row->seconds);
    count_confusion(*row, s);
    if (row->outcome == "wrong" || row->outcome == "failed" || has_extra(row->outcome))
      s.wrong.push_back(described(*row));
    if (row->expect != "name" || row->truth.size() != 1) continue;
    const double strength = row->truth.front().strength;
    s.strength[domain_of(*row)][class_of(strength)].add(row->outcome);
    std::size_t bin = kSweepBins.size() - 1;
    while (bin > 0 && !(strength >= kSweepBins[bin])) --bin;
    s.sweep[bin].second.add(row->outcome);
    if (strength >= 4 && !is_right(row->outcome) && row->outcome != "wrong")
      s.missed.push_back(described(*row));
  }
  s.goals.push_back(variants(all, s));
  return s;
}

std::string summary_text(const Summary& s) {
  std::string text = "| figure | goal | reached | 95 % interval | cases |\n|---|---|---|---|---|\n";
  for (const GoalFigure& g : s.goals) text += goal_row(g);

  text +=
      "\n| one effect, strength | cases | right | 95 % interval | abstained | wrong | with a "
      "wrong one more |\n|---|---|---|---|---|---|---|\n";
  for (const auto& [domain, classes] : s.strength)
    for (std::size_t c = 0; c < classes.size(); ++c) {
      const Outcomes& o = classes[c];
      const Rate right{o.right, o.of};
      const Interval i = right.interval();
      text += "| " + domain + " " + kStrengthClasses[c].title + " | " + to_string(o.of) + " | " +
              to_string(o.right) + " | " + percent(i.low) + " to " + percent(i.high) + " % | " +
              to_string(o.abstained()) + " | " + to_string(o.wrong) + " | " + to_string(o.extra) +
              " |\n";
    }

  text += "\n| confidence said | names | mean | right | 95 % interval |\n|---|---|---|---|---|\n";
  for (const Calibration& c : s.calibration) {
    if (c.right.of == 0) continue;
    const Interval i = c.right.interval();
    text += "| " + text_of(c.from) + " to " + text_of(c.to) + " | " + to_string(c.right.of) +
            " | " + text_of(c.confidence / static_cast<double>(c.right.of), "%.3f") + " | " +
            text_of(c.right.share(), "%.3f") + " | " + text_of(i.low, "%.3f") + " to " +
            text_of(i.high, "%.3f") + " |\n";
  }
  text += "\nBrier score " + text_of(s.brier, "%.4f") + " over " + to_string(s.names) +
          " named. A case takes " + text_of(quantile(s.seconds, 0.5), "%.1f") +
          " s of processor time in the median, " + text_of(quantile(s.seconds, 1), "%.1f") +
          " s at most.\n";

  confusion_table(text, "hidden: said, by strength", s.confusion);
  confusion_table(text, "two effects, poor motion, nothing, outside: said", s.nameless);

  text +=
      "\n| parameter, strength >= 4 | cases | median error [%] | 90 % [%] |\n|---|---|---|---|\n";
  for (const auto& [key, values] : s.parameter_errors)
    text += "| " + key + " | " + to_string(values.size()) + " | " +
            text_of(100 * quantile(values, 0.5), "%.2f") + " | " +
            text_of(100 * quantile(values, 0.9), "%.2f") + " |\n";

  text += std::string("\n| cell") + kOutcomeHeader;
  for (const auto& [cell, o] : s.cells) text += "| " + cell + " | " + outcome_cells(o);
  if (!s.comparator.empty()) {
    text += std::string("\n| plain library") + kOutcomeHeader;
    for (const auto& [cell, o] : s.comparator) text += "| " + cell + " | " + outcome_cells(o);
  }
  list(text, "Wrong, or no report:", s.wrong);
  list(text, "Missed at strength 4 and more, or another name under a change that must not matter:",
       s.missed);
  return text;
}

std::string summary_json(const Summary& s) {
  std::string json = "{\"goals\": [";
  const char* comma = "";
  for (const GoalFigure& g : s.goals) {
    const bool is_rate = g.q < 0;
    const Interval i = is_rate ? g.rate.interval() : quantile_interval(g.values, g.q);
    json += std::string(comma) + "\n  {\"figure\": \"" + g.title + "\", \"goal\": \"" + g.goal +
            "\", \"reached\": " + json_number(is_rate ? g.rate.share() : quantile(g.values, g.q)) +
            ", \"low\": " + json_number(i.low) + ", \"high\": " + json_number(i.high) +
            ", \"cases\": " + to_string(is_rate ? g.rate.of : g.values.size()) + "}";
    comma = ",";
  }
  json += "],\n \"strength\": {";
  comma = "";
  for (const auto& [domain, classes] : s.strength)
    for (std::size_t c = 0; c < classes.size(); ++c) {
      json += std::string(comma) + "\"" + domain + " " + kStrengthClasses[c].title +
              "\": " + outcome_json(classes[c]);
      comma = ",\n  ";
    }
  for (const auto& [key, cells] : {std::pair{"cells", &s.cells}, {"comparator", &s.comparator}}) {
    json += std::string("},\n \"") + key + "\": {";
    comma = "";
    for (const auto& [cell, o] : *cells) {
      json += std::string(comma) + "\"" + cell + "\": " + outcome_json(o);
      comma = ",\n  ";
    }
  }
  json += "}";
  confusion_json(json, "confusion", s.confusion);
  confusion_json(json, "nameless", s.nameless);
  json += ",\n \"parameter_errors\": {";
  comma = "";
  for (const auto& [key, values] : s.parameter_errors) {
    json += std::string(comma) + "\"" + key + "\": [" + json_number(quantile(values, 0.5)) + ", " +
            json_number(quantile(values, 0.9)) + ", " + to_string(values.size()) + "]";
    comma = ",\n  ";
  }
  json += "},\n \"calibration\": [";
  comma = "";
  for (const Calibration& c : s.calibration) {
    const auto n = static_cast<double>(c.right.of);
    json += std::string(comma) + "{\"from\": " + json_number(c.from) +
            ", \"to\": " + json_number(c.to) + ", \"names\": " + to_string(c.right.of) +
            ", \"mean\": " + json_number(c.confidence / n) +
            ", \"right\": " + json_number(c.right.share()) + "}";
    comma = ", ";
  }
  return json + "],\n \"brier\": " + json_number(s.brier) +
         ", \"closure_median\": " + json_number(quantile(s.closures, 0.5)) +
         ", \"closure_lowest_tenth\": " + json_number(quantile(s.closures, 0.1)) +
         ", \"seconds_median\": " + json_number(quantile(s.seconds, 0.5)) +
         ", \"seconds_longest\": " + json_number(quantile(s.seconds, 1)) + "}\n";
}

}  // namespace blind
