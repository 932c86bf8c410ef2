// One run of the workflow on a record of a drive: workflow.cpp (stages 1 to 8), calibration.cpp
// (stage 2), recalibration.cpp (once more with what was found), known_eccentricity.cpp (an
// eccentric encoder of the machine file), backlash_and_presliding.cpp (backlash, and the presliding
// distance that stood for it), proof.cpp (another record), changes.cpp (since an earlier record).
// views/: coordinates.cpp (of the maps), away_from_reversals.cpp, lower_band.cpp (backlash in a
// drive that swings), wider_bands.cpp (a mode beyond the working band), from_scale.cpp (what a
// scale on the stage shows).
#pragma once

#include <algorithm>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "reconcile/drive/candidates/candidates.hpp"
#include "reconcile/drive/controller_delay.hpp"
#include "reconcile/drive/motor_temperature.hpp"
#include "reconcile/drive/signals.hpp"
#include "reconcile/numerics/least_squares.hpp"
#include "reconcile/report/machine_file.hpp"
#include "servosense/core/expected.hpp"
#include "servosense/reconcile/decide.hpp"
#include "servosense/reconcile/drive.hpp"

namespace servosense::reconcile {

inline constexpr const char* kBacklash = "backlash";
inline constexpr const char* kLeadError = "lead-error";
inline constexpr const char* kEccentricity = "encoder-eccentricity";
/// How the phase of an eccentric encoder is called where a power-up has changed it.
inline constexpr const char* kEccentricityPhase = "encoder-eccentricity phase_rad";
inline constexpr const char* kConstantLoad = "constant-load";
/// How a recalibrated constant load is called: the key of its section is that of others, too.
inline const char* load_key(bool turns) {
  return turns ? "constant-load torque_Nm" : "constant-load force_N";
}

/// Keys of the machine file for what the model has.
struct Keys {
  const char *inertia, *viscous, *coulomb;
};
inline Keys keys_of(bool turns) {
  return turns ? Keys{"inertia_kg_m2", "viscous_friction_Nm_s_per_rad", "coulomb_friction_Nm"}
               : Keys{"equivalent_mass_kg", "viscous_friction_N_s_per_m", "coulomb_friction_N"};
}

/// A parameter of an effect that the machine file has.
struct KnownParameter {
  std::size_t setting = 0, parameter = 0;
  double error = 0;  ///< standard, once refitted
};

/// What the stages have fitted and decided so far.
struct DriveState {
  DriveState(const DriveData& data, double corner_hz)
      : given_(data.model),
        model_(data.model),
        signals_(std::make_shared<DriveSignals>(data, corner_hz)) {}

  DriveModelConfig given_;  // of the machine file, parameters of its effects refitted
  DriveModelConfig model_;
  std::shared_ptr<DriveSignals> signals_;  // candidates keep those that they were made of
  Problem problem_;
  std::vector<std::string> dropped_terms_;  // terms that are allowed for but not needed
  std::vector<Column> found_;      // effects of a first pass, while the calibration is repeated
  bool coulomb_found_ = false;     // the same of a friction that swings over as fitted
  bool presliding_found_ = false;  // its presliding distance was fitted with it
  double longest_beside_backlash_ = 0;  // beside backlash that was found; 0: any
  std::vector<double>
      backlash_;  // found together with the presliding distance: where to look for it again
  double presliding_alone_ = 0;           // of friction, as fitted before that backlash
  bool away_ = false;                     // the decision is one of the second look
  bool angle_corrected_ = false;          // the signals are those of the true angle
  double phase_error_ = 0;                // standard error, where the file's phase was fitted again
  std::vector<KnownParameter> refitted_;  // of the effects that the file has
  bool timing_found_ = false;             // one of them is a delay or a lag
  double delay_s_ = 0;                    // of the effort, as far as it is a nuisance
  double lateness_s_ = 0;                 // as fitted
  std::optional<ControllerDelay> controller_delay_;  // once it was asked for
  double known_lag_s_ = 0;  // what the file tells of the time behind the reported effort
  bool timing_open_ = false;
  bool constant_known_ = false;
  bool temperature_open_ =
      false;  // of the motor: the file's change of its constant is fitted again
  std::vector<Candidate> candidates_;
  Decision decision_;
  std::vector<EffectSetting> acting_;  // friction and loads that a first pass found
};

class DriveWorkflow : private DriveState {
 public:
  DriveWorkflow(const DriveData& data, const Options& options, double corner_hz)
      : DriveState(data, corner_hz),
        data_(data),
        options_(options),
        criteria_(options.criteria),
        limit_cycle_(find_limit_cycle(data, options.criteria)) {}

  /// `refuted`: names that another record spoke against.
  Expected<DriveOutcome> run(const std::vector<SecondGap>& refuted);
  /// The model of the last run on another record of the same drive.
  Expected<SecondRecord> prove(const DriveData& second) const;
  /// Where the report is that of the band in which the mode shows, so is `proof`.
  [[nodiscard]] std::optional<SecondGap> mode_on(const DriveData& second,
                                                 SecondRecord& proof) const;
  /// No name: what this motion cannot show or tell apart.
  Report refused(const Error& why);
  /// Most of what the last run left is in the upper half of its band.
  [[nodiscard]] bool residual_beyond_lower_band() const;

 private:
  /// A trial of the steps that follow, with signals of its own; adopted where it is the better one.
  [[nodiscard]] DriveWorkflow trial() const {
    DriveWorkflow copy = *this;
    copy.signals_ = std::make_shared<DriveSignals>(*signals_);
    return copy;
  }
  void adopt(DriveWorkflow better) { DriveState::operator=(std::move(better)); }
  /// Candidates for what the model lacks now.
  void offer();
  /// The same, and the decision on them.
  void decide_by(const Options& options);
  [[nodiscard]] std::string channel_name() const {
    return std::string(servosense::name_of(data_.channel));
  }
  Expected<Done> check_motion();
  void set_up();
  Expected<Done> calibrate();
  /// Backlash or a bristle.
  [[nodiscard]] bool acts_at_reversals(const Accepted& accepted) const;
  [[nodiscard]] bool still_late_beside(const std::vector<Column>& backlash);
  Expected<Done> calibrate_with_accepted(bool reversals);
  Expected<Done> calibrate_and_decide(bool reversals);
  [[nodiscard]] bool beyond_presliding_alone(const Decision& presliding_alone) const;
  Expected<Done> recalibrate();
  [[nodiscard]] bool any_at_reversals() const;
  Expected<Done> repeat_with_accepted();
  [[nodiscard]] bool has_accepted(std::string_view name) const;
  [[nodiscard]] bool timing_is_usual();
  const ControllerDelay& controller_delay_of_record();
  [[nodiscard]] double known_lag_s();
  [[nodiscard]] bool has_limit_cycle() const { return limit_cycle_.frequency_hz > 0; }
  [[nodiscard]] bool dropped(const char* name) const {
    return std::find(dropped_terms_.begin(), dropped_terms_.end(), name) != dropped_terms_.end();
  }
  void add_known(const char* name, Column column, double nominal, bool recalibrated) {
    if (dropped(name)) return;
    problem_.known.push_back({name, std::move(column), nominal, recalibrated});
  }
  void add_known_terms(bool with_coulomb = false);
  [[nodiscard]] Fit fit_known(double least_speed = 0) const;
  [[nodiscard]] std::optional<Told> fitted(const Fit& fit, std::string_view term) const;
  [[nodiscard]] Fit fit_beside_eccentricity() const;
  /// Inertia or friction as fitted; other terms are passed over.
  void set_parameter(DriveModelConfig& model, const std::string& term, double value) const;
  void drop_needless_terms();
  [[nodiscard]] bool presliding_beyond_reason() const;
  void fit_presliding_speed();
  void fit_timing();
  void report_phase(Report& report) const;
  [[nodiscard]] std::vector<KnownParameter> known_parameters() const;
  bool step_known_effects();
  void find_open_shares();
  void refit_known_effects();
  void report_known_effects(Report& report) const;
  [[nodiscard]] Column temperature_rows() const;
  [[nodiscard]] Column effort_per_kelvin() const;
  [[nodiscard]] std::pair<double, double> temperatures() const;
  [[nodiscard]] bool motor_warms() const;
  [[nodiscard]] std::optional<ConstantOverTemperature> constant_found() const;
  void report_constant(Report& report) const;
  void remark_on_size(Report& report, const KnownTerm& term, double value) const;
  void remark_on_timing(Report& report) const;
  void recalibrate_load(DriveOutcome& outcome, double value, double error) const;
  [[nodiscard]] double largest_effort() const;
  void add_coordinates();
  [[nodiscard]] DriveModelConfig with_found() const;
  [[nodiscard]] DriveSituation situation() const;
  [[nodiscard]] double nominal_gap() const;
  [[nodiscard]] std::vector<bool> away_from_reversals() const;
  void decide_away_from_reversals();
  [[nodiscard]] const Accepted* eccentricity() const;
  [[nodiscard]] bool backlash_worth_a_term() const;
  [[nodiscard]] double longest_presliding() const;
  [[nodiscard]] double shortest_presliding() const;
  std::vector<Column> fit_presliding_and_backlash();
  void refit_presliding_beside_backlash(const Options& options);
  bool correct_angle_by(const EffectSetting& error);
  bool correct_angle_by(const Meaning& meaning) {
    return correct_angle_by(setting_of(kEccentricity, meaning, data_.turns()));
  }
  void correct_angle_as_known();
  bool refit_known_phase();
  void correct_angle();
  [[nodiscard]] Fit fit_of_known();
  void report_parameters(DriveOutcome& outcome) const;
  void report_accepted(DriveOutcome& outcome) const;
  void add_from_scale(DriveOutcome& outcome) const;
  [[nodiscard]] Decision decide_on_mode() const;
  [[nodiscard]] std::vector<Column> beside_ripple() const;
  [[nodiscard]] bool mode_stands_out();
  const FoundEffect* mode_beside_others();
  void look_in_wider_bands(DriveOutcome& outcome);
  void show_in_band(Report& report, const DriveWorkflow& band, const DriveModelConfig& found);
  [[nodiscard]] double nominal_gap_in_band(const DriveData& data) const;
  /// An effect on another record; `power_up`: fitted again there.
  struct EffectThere {
    bool power_up = false;
    std::vector<Column> columns;
  };
  void take_over(const DriveWorkflow& first);
  [[nodiscard]] std::vector<EffectThere> effects_there(
      const std::vector<Candidate>& candidates) const;
  [[nodiscard]] Column gaps_there(const DriveWorkflow& w, const std::vector<EffectThere>& parts,
                                  const std::vector<std::size_t>& rows, const FitRows& anew) const;
  /// Simulations with the effects and without.
  [[nodiscard]] Proof prove_by_simulation(const DriveModelConfig& found) const;

  const DriveData& data_;
  const Options& options_;
  const Criteria& criteria_;
  const LimitCycle limit_cycle_;
  std::vector<std::string> refuted_;  // names that another record spoke against
  double mode_corner_hz_ = 0;     // of the wider band in which a coupling was found; 0: none was
  DriveModelConfig beside_mode_;  // all else
  bool shown_in_band_ = false;    // the report is that of the wider band
  double top_speed_ = 0;
};

/// A run in the working band, or in a lower one where backlash shows only there
/// (views/lower_band.cpp).
struct BandRun {
  std::unique_ptr<DriveWorkflow> workflow;
  Expected<DriveOutcome> outcome;
};
BandRun run_in_band(const DriveData& data, const Options& options, double corner_hz,
                    const std::vector<SecondGap>& refuted);

}  // namespace servosense::reconcile
