#include "servosense/io/json.hpp"

#include <ostream>

#include "reconcile/report/maintenance_advice.hpp"
#include "servosense/reconcile/report.hpp"

namespace servosense::reconcile {
namespace {

/// Name and value of one member after the other.
template <typename Value, typename... More>
void members(JsonWriter& json, const char* name, const Value& value, const More&... more) {
  json.member(name, value);
  if constexpr (sizeof...(more) > 0) members(json, more...);
}

/// A member that is an object, whose members `write()` writes; null unless it is `there`.
template <typename Write>
void put_object(JsonWriter& json, const char* name, Write write, bool there = true) {
  json.key(name);
  if (!there) {
    json.value(nullptr);
    return;
  }
  json.begin_object();
  write();
  json.end_object();
}

void put(JsonWriter& json, const char* name, const std::vector<NamedValue>& values) {
  put_object(json, name, [&] {
    for (const NamedValue& v : values) {
      if (!v.text.empty())
        json.member(v.key, v.text);
      else if (v.values.size() == 1)
        json.member(v.key, v.values[0]);
      else
        json.values(v.key, v.values);
    }
  });
}

void put(JsonWriter& json, const char* name, const std::vector<RankedCandidate>& ranking) {
  json.objects(name, ranking, [&](const RankedCandidate& c) {
    members(json, "name", c.name, "gap_after", c.gap_after, "explained", c.explained, "chance",
            c.chance, "objection", c.objection);
  });
}

void put(JsonWriter& json, const char* name, const std::vector<ResidualMap>& maps) {
  json.objects(name, maps, [&](const ResidualMap& m) {
    members(json, "variable", m.variable, "share", m.share, "probability", m.probability);
  });
}

void put(JsonWriter& json, const char* name, const std::vector<SecondGap>& gaps) {
  json.objects(name, gaps, [&](const SecondGap& g) {
    members(json, "name", g.name, "gap_before", g.gap_before, "gap_after", g.gap_after, "shown",
            g.shown);
    if (g.gap_band_hz > 0) json.member("gap_band_hz", g.gap_band_hz);
  });
}

/// Null when there was none.
void put(JsonWriter& json, const char* name, const SecondRecord& second) {
  const auto write = [&] {
    members(json, "trace", second.trace, "from_s", second.from_s, "to_s", second.to_s, "effort_rms",
            second.effort_rms, "gap_as_given", second.gap_nominal, "gap_before", second.gap_before,
            "gap_after", second.gap_after);
    put(json, "effects", second.effects);
    put(json, "refuted", second.refuted);
  };
  put_object(json, name, write, !second.trace.empty());
}

void put(JsonWriter& json, const char* name, const Departure& d) {
  put_object(json, name,
             [&] { members(json, "before", d.before, "after", d.after, "floor", d.floor); });
}

/// Null when nothing was simulated.
void put(JsonWriter& json, const char* name, const Proof& proof) {
  const FreeRun& run = proof.free_run;
  const ClosedLoop& loop = proof.closed_loop;
  const auto write = [&] {
    json.member("motion_unit", proof.motion_unit);
    put_object(json, "free_run", [&] {
      members(json, "not_shown", run.not_shown, "starts", run.starts);
      json.objects("horizons", run.horizons, [&](const FreeRun::Horizon& h) {
        json.member("horizon_s", h.horizon_s);
        put(json, "position", h.position);
        put(json, "speed", h.speed);
      });
    });
    put_object(json, "closed_loop", [&] {
      json.member("not_shown", loop.not_shown);
      if (loop.not_shown.empty())
        members(json, "following_error", loop.following_rms, "position_before",
                loop.position_before, "position_after", loop.position_after, "effort_before",
                loop.effort_before, "effort_after", loop.effort_after);
    });
  };
  put_object(json, name, write, !proof.motion_unit.empty());
}

void put_effects(JsonWriter& json, const Report& r) {
  json.objects("effects", r.effects, [&](const FoundEffect& e) {
    members(json, "name", e.name, "confidence", e.confidence);
    put(json, "parameters", e.parameters);
    put(json, "standard_errors", e.standard_errors);
    put_object(json, "where", [&] {
      members(json, "variable", e.where, "share_of_residual", e.share_of_residual);
    });
    json.values("class", e.class_members);
    if (!e.splitting_motion.empty()) json.member("split_by", e.splitting_motion);
    members(json, "scope", e.scope, "used_by_monitors", e.used_by_monitors);
    const MaintenanceAdvice words = maintenance_advice(e.name);
    members(json, "meaning", words.meaning, "remedy", words.remedy, "gap_before", e.gap_before,
            "gap_after", e.gap_after);
    if (!e.gap_unit.empty()) json.member("gap_unit", e.gap_unit);
    if (e.gap_band_hz > 0) json.member("gap_band_hz", e.gap_band_hz);
    const auto runner_up = [&] {
      members(json, "name", e.runner_up, "gap_after", e.runner_up_gap);
    };
    put_object(json, "runner_up", runner_up, !e.runner_up.empty());
    put(json, "ranking", e.ranking);
  });
}

/// What this record does not show, and what has changed since another one.
void put_limits(JsonWriter& json, const Report& r) {
  json.objects("not_testable", r.not_testable, [&](const NotTestable& n) {
    members(json, "name", n.name, "because", n.because, "would_need", n.would_need);
  });
  json.objects("classes", r.classes, [&](const Alike& a) {
    json.values("names", a.names);
    json.member("split_by", a.split_by);
  });
  json.objects("changed", r.changed, [&](const Change& c) {
    members(json, "name", c.name, "parameter", c.parameter, "before", c.before, "before_error",
            c.before_error, "after", c.after, "after_error", c.after_error);
  });
  json.key("changed_since");
  if (r.since.empty())
    json.value(nullptr);
  else
    json.value(r.since);
  json.objects("detectable", r.detectable, [&](const Detectable& d) {
    members(json, "name", d.name, "parameter", d.key, "from", d.value);
  });
}

/// Null where there is none.
void put(JsonWriter& json, const char* name, const std::optional<Told>& figure) {
  const auto write = [&] {
    members(json, "value", figure->value, "standard_error", figure->error);
  };
  put_object(json, name, write, figure.has_value());
}

/// Null where there are no two encoders.
void put(JsonWriter& json, const char* name, const BetweenEncoders& between) {
  const auto write = [&] {
    members(json, "unit", between.unit, "left", between.left);
    put(json, "backlash", between.backlash);
    put(json, "compliance", between.compliance);
    put(json, "held_resonance_hz", between.held_resonance_hz);
  };
  put_object(json, name, write, !between.unit.empty());
}

void put(JsonWriter& json, const char* name, const Criteria& criteria) {
  json.objects(name, list_of_criteria(), [&](const Criterion& c) {
    members(json, "name", c.name, "value", criteria.*c.value, "unit", c.unit, "kind",
            name_of(c.kind), "source", c.source, "calibrated_on", c.calibrated_on);
  });
}

}  // namespace

void write_json(const Report& r, std::ostream& out) {
  JsonWriter json(out, 1);
  json.begin_object();
  json.member("channel", r.channel);
  json.objects("bad_signals", r.bad_signals, [&](const BadSignal& bad) {
    members(json, "column", bad.column, "fault", bad.fault, "share", bad.share, "from_s",
            bad.from_s, "to_s", bad.to_s);
  });
  members(json, "verdict", name_of(r.verdict), "summary", r.summary, "noise_floor", r.floors.used,
          "gap_before", r.gap_before, "gap_after", r.gap_after, "gap_unit", r.gap_unit,
          "gap_as_given", r.gap_nominal, "effort_rms", r.effort_rms, "timing_s", r.timing_s);
  put_object(json, "held_out",
             [&] { members(json, "from_s", r.held_from_s, "to_s", r.held_to_s); });
  json.objects("recalibrated", r.recalibrated, [&](const Recalibrated& c) {
    members(json, "parameter", c.parameter, "from", c.from, "to", c.to, "standard_error",
            c.standard_error);
  });
  put_effects(json, r);
  put(json, "between_encoders", r.between_encoders);
  put(json, "proof", r.proof);
  put(json, "second_record", r.second);
  json.objects("time_locked", r.lines, [&](const TimeLine& line) {
    members(json, "frequency_hz", line.frequency_hz, "amplitude", line.amplitude);
  });
  put_limits(json, r);
  put_object(json, "residual", [&] {
    members(json, "white", r.residual_white, "detail", r.residual_detail);
    if (!r.resembles.empty()) json.member("resembles", r.resembles);
  });
  put_object(json, "floors", [&] {
    members(json, "lap", r.floors.lap, "local", r.floors.local, "encoder", r.floors.encoder);
  });
  put(json, "maps_before", r.maps_before);
  put(json, "maps_after", r.maps_after);
  put(json, "ranking", r.ranking);
  json.key("monitors");
  json.begin_array();
  for (std::size_t i = 0; i < r.monitors_before.size() && i < r.monitors_after.size(); ++i) {
    json.begin_object();
    members(json, "figure", r.monitors_before[i].first, "before", r.monitors_before[i].second,
            "after", r.monitors_after[i].second);
    json.end_object();
  }
  json.end_array();
  json.values("remarks", r.remarks);
  put(json, "criteria", r.criteria);
  json.end_object();
  out << '\n';
}

}  // namespace servosense::reconcile
