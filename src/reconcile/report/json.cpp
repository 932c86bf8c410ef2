#include "servosense/io/json.hpp"

#include <ostream>

#include "reconcile/report/maintenance_advice.hpp"
#include "servosense/reconcile/report.hpp"

namespace servosense::reconcile {
namespace {

void put(JsonWriter& json, const char* name, const std::vector<NamedValue>& values) {
  json.key(name);
  json.begin_object();
  for (const NamedValue& v : values) {
    if (!v.text.empty())
      json.member(v.key, v.text);
    else if (v.values.size() == 1)
      json.member(v.key, v.values[0]);
    else
      json.values(v.key, v.values);
  }
  json.end_object();
}

void put(JsonWriter& json, const char* name, const std::vector<RankedCandidate>& ranking) {
  json.objects(name, ranking, [&](const RankedCandidate& c) {
    json.member("name", c.name);
    json.member("gap_after", c.gap_after);
    json.member("explained", c.explained);
    json.member("chance", c.chance);
    json.member("objection", c.objection);
  });
}

void put(JsonWriter& json, const char* name, const std::vector<ResidualMap>& maps) {
  json.objects(name, maps, [&](const ResidualMap& m) {
    json.member("variable", m.variable);
    json.member("share", m.share);
    json.member("probability", m.probability);
  });
}

void put(JsonWriter& json, const char* name, const std::vector<SecondGap>& gaps) {
  json.objects(name, gaps, [&](const SecondGap& g) {
    json.member("name", g.name);
    json.member("gap_before", g.gap_before);
    json.member("gap_after", g.gap_after);
    json.member("shown", g.shown);
    if (g.gap_band_hz > 0) json.member("gap_band_hz", g.gap_band_hz);
  });
}

/// Null when there was none.
void put(JsonWriter& json, const char* name, const SecondRecord& second) {
  json.key(name);
  if (second.trace.empty()) {
    json.value(nullptr);
    return;
  }
  json.begin_object();
  json.member("trace", second.trace);
  json.member("from_s", second.from_s);
  json.member("to_s", second.to_s);
  json.member("effort_rms", second.effort_rms);
  json.member("gap_as_given", second.gap_nominal);
  json.member("gap_before", second.gap_before);
  json.member("gap_after", second.gap_after);
  put(json, "effects", second.effects);
  put(json, "refuted", second.refuted);
  json.end_object();
}

void put(JsonWriter& json, const char* name, const Departure& d) {
  json.key(name);
  json.begin_object();
  json.member("before", d.before);
  json.member("after", d.after);
  json.member("floor", d.floor);
  json.end_object();
}

/// Null when nothing was simulated.
void put(JsonWriter& json, const char* name, const Proof& proof) {
  json.key(name);
  if (proof.motion_unit.empty()) {
    json.value(nullptr);
    return;
  }
  json.begin_object();
  json.member("motion_unit", proof.motion_unit);
  json.key("free_run");
  json.begin_object();
  json.member("not_shown", proof.free_run.not_shown);
  json.member("starts", proof.free_run.starts);
  json.objects("horizons", proof.free_run.horizons, [&](const FreeRun::Horizon& h) {
    json.member("horizon_s", h.horizon_s);
    put(json, "position", h.position);
    put(json, "speed", h.speed);
  });
  json.end_object();
  json.key("closed_loop");
  json.begin_object();
  const ClosedLoop& loop = proof.closed_loop;
  json.member("not_shown", loop.not_shown);
  if (loop.not_shown.empty()) {
    json.member("following_error", loop.following_rms);
    json.member("position_before", loop.position_before);
    json.member("position_after", loop.position_after);
    json.member("effort_before", loop.effort_before);
    json.member("effort_after", loop.effort_after);
  }
  json.end_object();
  json.end_object();
}

void put_effects(JsonWriter& json, const Report& r) {
  json.objects("effects", r.effects, [&](const FoundEffect& e) {
    json.member("name", e.name);
    json.member("confidence", e.confidence);
    put(json, "parameters", e.parameters);
    put(json, "standard_errors", e.standard_errors);
    json.key("where");
    json.begin_object();
    json.member("variable", e.where);
    json.member("share_of_residual", e.share_of_residual);
    json.end_object();
    json.values("class", e.class_members);
    if (!e.splitting_motion.empty()) json.member("split_by", e.splitting_motion);
    json.member("scope", e.scope);
    json.member("used_by_monitors", e.used_by_monitors);
    const MaintenanceAdvice words = maintenance_advice(e.name);
    json.member("meaning", words.meaning);
    json.member("remedy", words.remedy);
    json.member("gap_before", e.gap_before);
    json.member("gap_after", e.gap_after);
    if (!e.gap_unit.empty()) json.member("gap_unit", e.gap_unit);
    if (e.gap_band_hz > 0) json.member("gap_band_hz", e.gap_band_hz);
    json.key("runner_up");
    if (e.runner_up.empty()) {
      json.value(nullptr);
    } else {
      json.begin_object();
      json.member("name", e.runner_up);
      json.member("gap_after", e.runner_up_gap);
      json.end_object();
    }
    put(json, "ranking", e.ranking);
  });
}

/// What this record does not show, and what has changed since another one.
void put_limits(JsonWriter& json, const Report& r) {
  json.objects("not_testable", r.not_testable, [&](const NotTestable& n) {
    json.member("name", n.name);
    json.member("because", n.because);
    json.member("would_need", n.would_need);
  });
  json.objects("classes", r.classes, [&](const Alike& a) {
    json.values("names", a.names);
    json.member("split_by", a.split_by);
  });
  json.objects("changed", r.changed, [&](const Change& c) {
    json.member("name", c.name);
    json.member("parameter", c.parameter);
    json.member("before", c.before);
    json.member("before_error", c.before_error);
    json.member("after", c.after);
    json.member("after_error", c.after_error);
  });
  json.key("changed_since");
  if (r.since.empty())
    json.value(nullptr);
  else
    json.value(r.since);
  json.objects("detectable", r.detectable, [&](const Detectable& d) {
    json.member("name", d.name);
    json.member("parameter", d.key);
    json.member("from", d.value);
  });
}

/// Null where there are no two encoders.
void put(JsonWriter& json, const char* name, const BetweenEncoders& between) {
  json.key(name);
  if (between.unit.empty()) {
    json.value(nullptr);
    return;
  }
  const auto told = [&](const char* what, const std::optional<Told>& figure) {
    json.key(what);
    if (!figure) {
      json.value(nullptr);
      return;
    }
    json.begin_object();
    json.member("value", figure->value);
    json.member("standard_error", figure->error);
    json.end_object();
  };
  json.begin_object();
  json.member("unit", between.unit);
  json.member("left", between.left);
  told("backlash", between.backlash);
  told("compliance", between.compliance);
  told("held_resonance_hz", between.held_resonance_hz);
  json.end_object();
}

void put(JsonWriter& json, const char* name, const Criteria& criteria) {
  json.objects(name, list_of_criteria(), [&](const Criterion& c) {
    json.member("name", c.name);
    json.member("value", criteria.*c.value);
    json.member("unit", c.unit);
    json.member("kind", name_of(c.kind));
    json.member("source", c.source);
    json.member("calibrated_on", c.calibrated_on);
  });
}

}  // namespace

void write_json(const Report& r, std::ostream& out) {
  JsonWriter json(out, 1);
  json.begin_object();
  json.member("channel", r.channel);
  json.key("bad_signals");
  json.begin_array();
  for (const BadSignal& bad : r.bad_signals) {
    json.begin_object();
    json.member("column", bad.column);
    json.member("fault", bad.fault);
    json.member("share", bad.share);
    json.member("from_s", bad.from_s);
    json.member("to_s", bad.to_s);
    json.end_object();
  }
  json.end_array();
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
  json.objects("recalibrated", r.recalibrated, [&](const Recalibrated& c) {
    json.member("parameter", c.parameter);
    json.member("from", c.from);
    json.member("to", c.to);
    json.member("standard_error", c.standard_error);
  });
  put_effects(json, r);
  put(json, "between_encoders", r.between_encoders);
  put(json, "proof", r.proof);
  put(json, "second_record", r.second);
  json.objects("time_locked", r.lines, [&](const TimeLine& line) {
    json.member("frequency_hz", line.frequency_hz);
    json.member("amplitude", line.amplitude);
  });
  put_limits(json, r);
  json.key("residual");
  json.begin_object();
  json.member("white", r.residual_white);
  json.member("detail", r.residual_detail);
  if (!r.resembles.empty()) json.member("resembles", r.resembles);
  json.end_object();
  json.key("floors");
  json.begin_object();
  json.member("lap", r.floors.lap);
  json.member("local", r.floors.local);
  json.member("encoder", r.floors.encoder);
  json.end_object();
  put(json, "maps_before", r.maps_before);
  put(json, "maps_after", r.maps_after);
  put(json, "ranking", r.ranking);
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
  json.values("remarks", r.remarks);
  put(json, "criteria", r.criteria);
  json.end_object();
  out << '\n';
}

}  // namespace servosense::reconcile
