// The scorer's rules, on reports written by hand.
#include <cmath>
#include <string>
#include <vector>

#include "case.hpp"
#include "check.hpp"
#include "comparator.hpp"
#include "json.hpp"
#include "score.hpp"

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
  CHECK(row.parameter_errors.size() == 2);
  CHECK_NEAR(row.parameter_errors[0].second, 0.05, 1e-9);
  CHECK_NEAR(row.parameter_errors[1].second, 0.001, 1e-9);
  const blind::Row again = blind::row_of(Json::parse(blind::row_json(row)));
  CHECK_TEXT(blind::row_json(again), blind::row_json(row));
  std::string json;
  const std::string text = blind::summary({row, again}, json);
  CHECK(text.find("Brier score 0.0009 over 2 named") != std::string::npos);
  CHECK(Json::parse(json)["closure_median"].number == 0.75);
  CHECK(Json::parse(json)["strength"]["drive 4..8"]["right"].number == 2);

  std::string why;
  CHECK(blind::acceptable({row}, why));
  blind::Row bad = row;
  bad.outcome = "wrong";
  CHECK(!blind::acceptable({row, bad}, why));
  bad.outcome = "none";
  CHECK(blind::acceptable({row, bad}, why));
  CHECK(!blind::acceptable({row, bad, bad}, why));
  CHECK(!blind::acceptable({}, why));
  CHECK_TEXT(blind::score(c, Json::parse("no report"), 0).outcome, "failed");
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
  json();
  comparator();
  return check::done();
}
