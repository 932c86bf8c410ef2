// The scorer's rules, on reports written by hand.
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "case.hpp"
#include "check.hpp"
#include "comparator.hpp"
#include "json.hpp"
#include "pictures.hpp"
#include "score.hpp"
#include "summary.hpp"

namespace {

using blind::HiddenEffect;
using blind::Json;
using blind::SaidEffect;

std::string judged(const std::string& expect, const std::vector<std::string>& truth,
                   const std::vector<SaidEffect>& said, bool agrees = false) {
  std::vector<HiddenEffect> effects;
  for (const std::string& name : truth) effects.push_back({name, {}, 5, 5});
  return blind::outcome_of(expect, effects, said, agrees);
}

void outcomes() {
  const SaidEffect backlash{"backlash", {}, 0.9};
  const SaidEffect of_three{"presliding-hysteresis", {"backlash", "flexible-coupling"}, 0.6};
  const SaidEffect of_four{"presliding-hysteresis", {"backlash", "runout", "spring-load"}, 0.4};
  const SaidEffect drag{"quadratic-drag", {}, 0.8};
  CHECK_TEXT(judged("name", {"backlash"}, {backlash}), "right");
  CHECK_TEXT(judged("name", {"backlash"}, {of_three}), "right");
  CHECK_TEXT(judged("name", {"backlash"}, {of_four}), "wrong");
  CHECK_TEXT(judged("name", {"backlash"}, {drag}), "wrong");
  CHECK_TEXT(judged("name", {"backlash"}, {backlash, drag}), "right+extra");
  CHECK_TEXT(judged("name", {"backlash"}, {}, true), "none");
  CHECK_TEXT(judged("name", {"backlash"}, {}), "unexplained");
  CHECK_TEXT(judged("none", {}, {drag}), "wrong");
  CHECK_TEXT(judged("none", {}, {}, true), "none");
  CHECK_TEXT(judged("outside", {"friction-bump"}, {drag}), "wrong");
  CHECK_TEXT(judged("outside", {"friction-bump"}, {}), "unexplained");
  CHECK_TEXT(judged("line", {"time-locked-vibration"}, {{"time-locked-vibration", {}, 1}}),
             "right");
  CHECK_TEXT(judged("name", {"backlash", "quadratic-drag"}, {drag, backlash}), "both");
  CHECK_TEXT(judged("name", {"backlash", "quadratic-drag"}, {drag}), "one");
  CHECK_TEXT(judged("name", {"constant-load"}, {{"asymmetric-friction", {}, 1}}), "right");
  CHECK_TEXT(judged("name", {"asymmetric-friction"}, {{"constant-load", {}, 1}}), "wrong");
}

/// A report with figures, through the row and back.
void figures() {
  blind::Case c;
  c.name = "drive/single/torque-ripple";
  c.seed = 12;
  c.truth.expect = "name";
  c.truth.effects = {{"torque-ripple", {{"amplitude_N", 10}, {"order", 6}}, 5, 5}};
  c.truth.gap_before = 10;
  c.truth.gap_oracle = 2;
  const Json report = Json::parse(R"({"verdict": "explained", "gap_before": 20, "gap_after": 8,
    "effects": [{"name": "torque-ripple", "confidence": 0.97, "class": [],
                 "parameters": {"order": [2, 6.006], "amplitude_N": [1, 9.5]}}]})");
  const blind::Row row = blind::score(c, report, 1.5);
  CHECK_TEXT(row.outcome, "right");
  // Closed 60 % where the oracle closes 80 %.
  CHECK_NEAR(row.closure, 0.75, 1e-12);
  c.name = "milling/single/torque-ripple";
  // From 20 to 8, where the oracle leaves 2 of the same.
  CHECK_NEAR(blind::score(c, report, 1.5).closure, 12.0 / 18.0, 1e-12);
  CHECK(row.parameter_errors.size() == 2);
  CHECK_NEAR(row.parameter_errors[0].second, 0.05, 1e-9);
  CHECK_NEAR(row.parameter_errors[1].second, 0.001, 1e-9);
  const blind::Row again = blind::row_of(Json::parse(blind::row_json(row)));
  CHECK_TEXT(blind::row_json(again), blind::row_json(row));
  const blind::Summary both = blind::summarise({row, again});
  CHECK(blind::summary_text(both).find("Brier score 0.0009 over 2 named") != std::string::npos);
  const Json json = Json::parse(blind::summary_json(both));
  CHECK(json["closure_median"].number == 0.75);
  CHECK(json["strength"]["drive >= 4"]["right"].number == 2);
  CHECK(json["confusion"]["torque-ripple"][">= 4"]["torque-ripple"].number == 2);

  std::string why;
  CHECK(blind::acceptable({row}, why));
  blind::Row bad = row;
  bad.outcome = "wrong";
  CHECK(!blind::acceptable({row, bad}, why));
  bad.outcome = "none";
  CHECK(blind::acceptable({row, row, row, row, bad}, why));
  CHECK(!blind::acceptable({row, row, row, bad}, why));
  CHECK(!blind::acceptable({}, why));
  CHECK_TEXT(blind::score(c, Json::parse("no report"), 0).outcome, "failed");
}

/// What shows of the background may be named; what does not show may not.
void background() {
  blind::Case c;
  c.name = "second-milling/null";
  c.truth.expect = "none";
  const Json report = Json::parse(
      R"({"verdict": "explained", "effects": [{"name": "runout", "confidence": 0.9}]})");
  for (const double strength : {0.5, 5.0}) {
    c.truth.background = {{"runout", {}, strength, 0}};
    CHECK_TEXT(blind::score(c, report, 1).outcome, strength < 1 ? "wrong" : "unexplained");
  }
}

/// Examples of Newcombe (1998, table I, method 3).
void intervals() {
  struct Example {
    std::size_t hits, of;
    double low, high;
  };
  for (const auto& [hits, of, low, high] : {Example{81, 263, 0.2553, 0.3662},
                                            {15, 148, 0.0624, 0.1605},
                                            {0, 20, 0.0000, 0.1611},
                                            {1, 29, 0.0061, 0.1718}}) {
    const blind::Interval i = blind::Rate{hits, of}.interval();
    CHECK_NEAR(i.low, low, 5e-5);
    CHECK_NEAR(i.high, high, 5e-5);
  }
  // Of 1 ... 100 the ranks 40 to 60 enclose the median with 95 %.
  std::vector<double> numbers;
  for (int k = 1; k <= 100; ++k) numbers.push_back(k);
  const blind::Interval i = blind::quantile_interval(numbers, 0.5);
  CHECK_NEAR(i.low, 41, 0);
  CHECK_NEAR(i.high, 61, 0);
}

blind::Row made(const std::string& name, const std::string& expect,
                const std::vector<HiddenEffect>& truth, const std::vector<SaidEffect>& said) {
  blind::Row row;
  static std::uint64_t seed = 0;
  row.name = name;
  row.seed = ++seed;
  row.expect = expect;
  row.truth = truth;
  row.said = said;
  row.outcome = blind::outcome_of(expect, truth, said, false);
  return row;
}

/// Each case counts in the figures that it is about, and in no other.
void goals() {
  const HiddenEffect strong{"backlash", {}, 5, 5}, weak{"backlash", {}, 1.5, 1};
  const HiddenEffect drag{"quadratic-drag", {}, 8, 8};
  const SaidEffect right{"backlash", {}, 0.97}, wrong{"spring-load", {}, 0.6};
  blind::Row poor = made("drive/poor/backlash", "class", {strong}, {});
  poor.motion = true;
  blind::Row turned = made("drive/single/backlash", "name", {strong}, {wrong});
  turned.variant = "reversed";
  const blind::Row plain = made("drive/single/backlash", "name", {strong}, {right});
  turned.seed = plain.seed;
  const blind::Summary s = blind::summarise(
      {plain, turned, made("drive/single/backlash", "name", {strong}, {right, wrong}),
       made("drive/single/backlash", "name", {weak}, {wrong}),
       made("drive/null", "none", {}, {wrong}), made("spindle/null", "none", {}, {}),
       made("drive/outside/unseen-axis", "outside", {{"unseen-axis", {}, 9, 9}}, {}),
       made("drive/pair", "name", {strong, drag}, {right}), poor,
       made("drive/poor/backlash", "class", {strong}, {})});
  const auto figure = [&](const std::string& title) {
    for (const blind::GoalFigure& g : s.goals)
      if (g.title.starts_with(title))
        return std::to_string(g.rate.hits) + "/" + std::to_string(g.rate.of);
    return std::string("no such figure");
  };
  CHECK_TEXT(figure("right name, one effect, strength >= 4"), "2/2");
  CHECK_TEXT(figure("the same, strength 2 to 4"), "0/0");
  CHECK_TEXT(figure("the same, strength 1 to 2"), "0/1");
  CHECK_TEXT(figure("wrong name, an effect hidden"), "1/4");
  CHECK_TEXT(figure("a wrong name beside the right one"), "1/3");
  CHECK_TEXT(figure("a name where nothing is hidden"), "1/2");
  CHECK_TEXT(figure("a wrong name for what is not in the catalogue"), "0/1");
  CHECK_TEXT(figure("both of two effects"), "0/1");
  CHECK_TEXT(figure("a third, wrong name"), "0/1");
  CHECK_TEXT(figure("poor motion"), "1/2");
  CHECK_TEXT(figure("same names when scaled"), "0/1");
  // Three of six names are right; those that are not were said with 0.6.
  CHECK(s.names == 6);
  CHECK_NEAR(s.brier, (3 * 0.03 * 0.03 + 3 * 0.6 * 0.6) / 6, 1e-12);
  for (const blind::Picture& p : blind::pictures_of(s)) {
    CHECK(p.svg.starts_with("<svg ") && p.svg.ends_with("</svg>\n"));
    CHECK(p.svg.find("nan") == std::string::npos && p.svg.find("inf") == std::string::npos);
    CHECK(p.svg.size() < 60000);
  }
  for (const blind::Picture& p : blind::pictures_of(blind::summarise({})))
    CHECK(p.svg.find("nan") == std::string::npos);
}

/// What the scorer reads must be JSON, and what is not must not pass for it.
void json() {
  CHECK(Json::parse(R"({"a": [1, -2.5e3, null, true, "x\"y"]})")["a"].items.size() == 5);
  CHECK(Json::parse(R"({"a": [1, -2.5e3]})")["a"].items[1].number == -2500);
  CHECK(Json::parse(R"({"a": )").kind == Json::Kind::null);
  CHECK(Json::parse("").kind == Json::Kind::null);
}

/// The comparator answers always: it finds a strong load, and names something in a null case.
void comparator() {
  const std::vector<std::string> load =
      blind::plain_library(blind::draw_case("drive/single/constant-load", 4, "plain"));
  CHECK(!load.empty() && load.front() == "constant-load");
  CHECK(blind::plain_library(blind::draw_case("milling/null", 1, "plain")).empty());
}

}  // namespace

int main() {
  outcomes();
  figures();
  background();
  intervals();
  goals();
  json();
  comparator();
  return check::done();
}
