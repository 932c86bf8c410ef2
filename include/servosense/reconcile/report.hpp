// The answer of the reconcile workflow; reconcile.json holds the same (docs/reconcile.md).
#pragma once

#include <iosfwd>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/reconcile/criteria.hpp"
#include "servosense/reconcile/problem.hpp"

namespace servosense::reconcile {

enum class Verdict { agrees, explained, partly_explained, unexplained };
[[nodiscard]] const char* name_of(Verdict verdict) noexcept;

struct Recalibrated {
  std::string parameter;
  double from = 0;
  double to = 0;
  double standard_error = 0;
};

/// One candidate in the ranking of a step.
struct RankedCandidate {
  std::string name;
  double gap_after = 0;   ///< rms of what is left, on rows left out of the fit
  double explained = 0;   ///< share of what is beyond the noise
  std::string objection;  ///< why it cannot be named; empty when it can
  double chance = 0;      ///< gain that noise alone would show
};

/// How much of the residual is a function of one coordinate.
struct ResidualMap {
  std::string variable;
  std::string unit;
  double share = 0;        ///< of the residual's variance, on rows left out
  double probability = 1;  ///< that chance does as well, corrected for the number of maps
  Column at, mean;         ///< of the bins
};

struct FoundEffect {
  std::string name;
  double confidence = 0;
  std::vector<NamedValue> parameters;
  std::vector<NamedValue> standard_errors;
  std::string where;
  double share_of_residual = 0;
  std::vector<std::string> class_members;  ///< what this motion cannot tell from it
  std::string splitting_motion;
  std::string scope;
  bool used_by_monitors = true;  ///< false: they read more with it, it is for other models only
  double gap_before = 0, gap_after = 0;  ///< held out
  std::string gap_unit;                  ///< empty: that of the report
  double gap_band_hz = 0;                ///< its gaps are those up to here; 0: those of the report
  std::string runner_up;
  double runner_up_gap = 0;
  std::vector<RankedCandidate> ranking;
};

struct NotTestable {
  std::string name, because, would_need;
};

/// Effects that the motion of this record cannot tell from each other, whichever is there.
struct Alike {
  std::vector<std::string> names;
  std::string split_by;  ///< the motion that would
};

/// Smallest size of an effect that this record would have shown.
struct Detectable {
  std::string name, key;
  double value = 0;
};

/// A parameter that is not what it was at an earlier record.
struct Change {
  std::string name;  ///< the effect, or "inertia"
  std::string parameter;
  double before = 0, before_error = 0;
  double after = 0, after_error = 0;
};

/// A line fixed in time: not of the machine's model.
struct TimeLine {
  double frequency_hz = 0;
  double amplitude = 0;
};

/// What an effect does on a second record, on which nothing was fitted.
struct SecondGap {
  std::string name;
  double gap_before = 0, gap_after = 0;  ///< without and with it, those found earlier included
  bool shown = true;                     ///< false: this record moves too little for it
  double gap_band_hz = 0;                ///< they are those up to here; 0: those of the record
};

/// The model of the first record on another one of the same drive.
struct SecondRecord {
  std::string trace;  ///< where it came from; empty: there was none
  double from_s = 0, to_s = 0;
  double effort_rms = 0;
  double gap_nominal = 0;  ///< of the machine file as it is
  double gap_before = 0;   ///< recalibrated on the first record
  double gap_after = 0;    ///< with the effects found there
  std::vector<SecondGap> effects;
  std::vector<SecondGap> refuted;  ///< found on the first record, no gain here: not named
};

/// Samples that no sensor of this drive can have measured, left out before anything was compared.
struct BadSignal {
  std::string column, fault;
  double share = 0;  ///< of its samples
  double from_s = 0, to_s = 0;
};
/// The same in a sentence.
[[nodiscard]] std::string sentence_of(const BadSignal& bad);

/// Rms of a departure from the measurement: without the effects, with them, and that which noise
/// alone causes.
struct Departure {
  double before = 0, after = 0, floor = 0;
};

/// The model left to itself under the measured effort, from measured states, on the held-out part.
struct FreeRun {
  struct Horizon {
    double horizon_s = 0;
    Departure position, speed;  ///< at its end [m, m/s or rad, rad/s]
  };
  std::string not_shown;  ///< why; empty when it is
  std::size_t starts = 0;
  std::vector<Horizon> horizons;
  Column time_s, measured, before, after;  ///< position along one of the runs
};

/// The drive under its controller, along the commanded motion, on the held-out part.
struct ClosedLoop {
  std::string not_shown;                           ///< why; empty when it is
  double following_rms = 0;                        ///< of the measured following error
  double position_before = 0, position_after = 0;  ///< rms of simulated less measured position
  double effort_before = 0, effort_after = 0;      ///< the same of the effort, filtered
};

/// What the effects do for a simulation.
struct Proof {
  std::string motion_unit;  ///< m or rad; empty: nothing was simulated
  FreeRun free_run;
  ClosedLoop closed_loop;
};

/// A figure and its standard error.
struct Told {
  double value = 0, error = 0;
};

/// What the encoder of the load and that of the motor show between them.
struct BetweenEncoders {
  std::string unit;                       ///< m or rad; empty: there are no two
  double left = 0;                        ///< that nothing explains, rms
  std::optional<Told> backlash;           ///< none where something pulls at the load
  std::optional<Told> compliance;         ///< m/N or rad/Nm of the drive's effort; none: not seen
  std::optional<Told> held_resonance_hz;  ///< of the load, motor held
};

/// Forces over one turn of the tool, means of the turns at one feed.
struct MeanTurn {
  struct Component {
    std::string name;
    Column measured, before, after;
  };
  std::size_t turns = 0;  ///< 0: there is no such picture
  double feed_per_tooth_m = 0;
  bool held_out = false;  ///< no part in the fit
  Column angle_rad;
  std::vector<Component> components;
};

struct Report {
  std::string channel;
  Verdict verdict = Verdict::agrees;
  std::string summary;  ///< one sentence
  std::string gap_unit;
  Floors floors;
  double effort_rms = 0;   ///< of the motor, same filter
  double timing_s = 0;     ///< by which the effort acts late, as fitted
  double gap_nominal = 0;  ///< of the machine file as it is
  double gap_before = 0;   ///< recalibrated
  double gap_after = 0;
  double held_from_s = 0, held_to_s = 0;
  std::vector<Recalibrated> recalibrated;
  std::vector<FoundEffect> effects;
  BetweenEncoders between_encoders;
  Proof proof;
  SecondRecord second;
  std::vector<TimeLine> lines;
  std::vector<NotTestable> not_testable;
  std::vector<Alike> classes;
  std::vector<Change> changed;  ///< since the record named in `since`
  std::string since;
  std::vector<Detectable> detectable;
  std::vector<ResidualMap> maps_before, maps_after;
  std::vector<RankedCandidate> ranking;  ///< of the last step, when nothing was added
  bool residual_white = true;
  std::string residual_detail;
  std::string resembles;  ///< what a gap without a name looks like; empty: nothing known
  std::vector<std::pair<std::string, double>> monitors_before, monitors_after;
  std::vector<BadSignal> bad_signals;
  std::vector<std::string> remarks;
  Column time_s, measured, simulated_before, simulated_after;  ///< for the pictures
  std::vector<bool> compared;  ///< rows that gaps are made of; empty: all
  MeanTurn mean_turn;          ///< of a cut
  Criteria criteria;           ///< by which all this was decided
};

/// Its gaps are of another comparison than those of the report: of a scale, of a wider band.
[[nodiscard]] inline bool has_own_gap(const FoundEffect& e) {
  return e.gap_band_hz > 0 || !e.gap_unit.empty();
}

/// The first line of every report: what is missing in `subject` (a channel, a cut), how sure, how
/// much of the gap it closes, what the monitors gain.
[[nodiscard]] std::string summary_of(const Report& report, const std::string& subject);

/// What a simulation gains by the effects, one sentence; empty when nothing was simulated.
[[nodiscard]] std::string proof_of(const Report& report);

/// What the effects mean for the machine and what to do about them, a line each.
[[nodiscard]] std::string maintenance_advice_of(const Report& report);

/// reconcile.json.
void write_json(const Report& report, std::ostream& out);
/// report.html. Device error if the file cannot be written.
Expected<Done> write_page(const Report& report, const std::string& path);

}  // namespace servosense::reconcile
