#include <ostream>

#include "servosense/io/json.hpp"
#include "servosense/reconcile/report.hpp"

namespace servosense::reconcile {
namespace {

void put(JsonWriter& json, const std::vector<NamedValue>& values) {
  json.begin_object();
  for (const NamedValue& v : values) {
    json.key(v.key);
    if (!v.text.empty()) {
      json.value(v.text);
    } else if (v.values.size() == 1) {
      json.value(v.values[0]);
    } else {
      json.begin_array();
      for (const double x : v.values) json.value(x);
      json.end_array();
    }
  }
  json.end_object();
}

void put(JsonWriter& json, const std::vector<RankedCandidate>& ranking) {
  json.begin_array();
  for (const RankedCandidate& c : ranking) {
    json.begin_object();
    json.member("name", c.name);
    json.member("gap_after", c.gap_after);
    json.member("explained", c.explained);
    json.member("chance", c.chance);
    json.member("objection", c.objection);
    json.end_object();
  }
  json.end_array();
}

void put(JsonWriter& json, const std::vector<ResidualMap>& maps) {
  json.begin_array();
  for (const ResidualMap& m : maps) {
    json.begin_object();
    json.member("variable", m.variable);
    json.member("share", m.share);
    json.member("probability", m.probability);
    json.end_object();
  }
  json.end_array();
}

/// Null when there was none.
void put(JsonWriter& json, const SecondRecord& second) {
  if (second.trace.empty()) {
    json.value(nullptr);
    return;
  }
  const auto gaps = [&](const char* key, const std::vector<SecondGap>& all) {
    json.key(key);
    json.begin_array();
    for (const SecondGap& g : all) {
      json.begin_object();
      json.member("name", g.name);
      json.member("gap_before", g.gap_before);
      json.member("gap_after", g.gap_after);
      json.member("shown", g.shown);
      json.end_object();
    }
    json.end_array();
  };
  json.begin_object();
  json.member("trace", second.trace);
  json.member("from_s", second.from_s);
  json.member("to_s", second.to_s);
  json.member("effort_rms", second.effort_rms);
  json.member("gap_as_given", second.gap_nominal);
  json.member("gap_before", second.gap_before);
  json.member("gap_after", second.gap_after);
  gaps("effects", second.effects);
  gaps("refuted", second.refuted);
  json.end_object();
}

}  // namespace

void write_json(const Report& r, std::ostream& out) {
  JsonWriter json(out, 1);
  json.begin_object();
  json.member("channel", r.channel);
  json.member("verdict", name_of(r.verdict));
  json.member("summary", r.summary);
  json.member("noise_floor", r.floors.used);
  json.member("gap_before", r.gap_before);
  json.member("gap_after", r.gap_after);
  json.member("gap_unit", r.gap_unit);
  json.member("gap_as_given", r.gap_nominal);
  json.member("effort_rms", r.effort_rms);
  json.member("timing_s", r.timing_s);
  json.key("held_out");
  json.begin_object();
  json.member("from_s", r.held_from_s);
  json.member("to_s", r.held_to_s);
  json.end_object();
  json.key("recalibrated");
  json.begin_array();
  for (const Recalibrated& c : r.recalibrated) {
    json.begin_object();
    json.member("parameter", c.parameter);
    json.member("from", c.from);
    json.member("to", c.to);
    json.member("standard_error", c.standard_error);
    json.end_object();
  }
  json.end_array();
  json.key("effects");
  json.begin_array();
  for (const FoundEffect& e : r.effects) {
    json.begin_object();
    json.member("name", e.name);
    json.member("confidence", e.confidence);
    json.key("parameters");
    put(json, e.parameters);
    json.key("standard_errors");
    put(json, e.standard_errors);
    json.key("where");
    json.begin_object();
    json.member("variable", e.where);
    json.member("share_of_residual", e.share_of_residual);
    json.end_object();
    json.key("class");
    json.begin_array();
    for (const std::string& name : e.class_members) json.value(name);
    json.end_array();
    if (!e.splitting_motion.empty()) json.member("split_by", e.splitting_motion);
    json.member("scope", e.scope);
    json.member("gap_before", e.gap_before);
    json.member("gap_after", e.gap_after);
    if (!e.gap_unit.empty()) json.member("gap_unit", e.gap_unit);
    json.key("runner_up");
    if (e.runner_up.empty()) {
      json.value(nullptr);
    } else {
      json.begin_object();
      json.member("name", e.runner_up);
      json.member("gap_after", e.runner_up_gap);
      json.end_object();
    }
    json.key("ranking");
    put(json, e.ranking);
    json.end_object();
  }
  json.end_array();
  json.key("second_record");
  put(json, r.second);
  json.key("time_locked");
  json.begin_array();
  for (const TimeLine& line : r.lines) {
    json.begin_object();
    json.member("frequency_hz", line.frequency_hz);
    json.member("amplitude", line.amplitude);
    json.end_object();
  }
  json.end_array();
  json.key("not_testable");
  json.begin_array();
  for (const NotTestable& n : r.not_testable) {
    json.begin_object();
    json.member("name", n.name);
    json.member("because", n.because);
    json.member("would_need", n.would_need);
    json.end_object();
  }
  json.end_array();
  json.key("classes");
  json.begin_array();
  for (const Alike& a : r.classes) {
    json.begin_object();
    json.key("names");
    json.begin_array();
    for (const std::string& name : a.names) json.value(name);
    json.end_array();
    json.member("split_by", a.split_by);
    json.end_object();
  }
  json.end_array();
  json.key("changed");
  json.begin_array();
  for (const Change& c : r.changed) {
    json.begin_object();
    json.member("name", c.name);
    json.member("parameter", c.parameter);
    json.member("before", c.before);
    json.member("before_error", c.before_error);
    json.member("after", c.after);
    json.member("after_error", c.after_error);
    json.end_object();
  }
  json.end_array();
  json.key("changed_since");
  if (r.since.empty())
    json.value(nullptr);
  else
    json.value(r.since);
  json.key("detectable");
  json.begin_array();
  for (const Detectable& d : r.detectable) {
    json.begin_object();
    json.member("name", d.name);
    json.member("parameter", d.key);
    json.member("from", d.value);
    json.end_object();
  }
  json.end_array();
  json.key("residual");
  json.begin_object();
  json.member("white", r.residual_white);
  json.member("detail", r.residual_detail);
  json.end_object();
  json.key("floors");
  json.begin_object();
  json.member("lap", r.floors.lap);
  json.member("local", r.floors.local);
  json.end_object();
  json.key("maps_before");
  put(json, r.maps_before);
  json.key("maps_after");
  put(json, r.maps_after);
  json.key("ranking");
  put(json, r.ranking);
  json.key("monitors");
  json.begin_array();
  for (std::size_t i = 0; i < r.monitors_before.size() && i < r.monitors_after.size(); ++i) {
    json.begin_object();
    json.member("figure", r.monitors_before[i].first);
    json.member("before", r.monitors_before[i].second);
    json.member("after", r.monitors_after[i].second);
    json.end_object();
  }
  json.end_array();
  json.key("remarks");
  json.begin_array();
  for (const std::string& s : r.remarks) json.value(s);
  json.end_array();
  json.end_object();
  out << '\n';
}

}  // namespace servosense::reconcile
