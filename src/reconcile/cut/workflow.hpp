// The stages of reconciling a cut, in the order of their use: calibrate, remove what is fixed in
// time, search, name, prove, report. One file each, cut/<stage>.cpp.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "reconcile/cut/effects.hpp"
#include "reconcile/cut/fit.hpp"
#include "reconcile/cut/lines.hpp"
#include "reconcile/cut/modulation.hpp"
#include "reconcile/cut/transients.hpp"
#include "reconcile/numerics/least_squares.hpp"
#include "reconcile/report/machine_file.hpp"
#include "servosense/reconcile/cutting.hpp"

namespace servosense::reconcile {

class CuttingWorkflow {
 public:
  CuttingWorkflow(CuttingData data, const Options& options)
      : data_(std::move(data)), options_(options), criteria_(options.criteria) {}
  Expected<CuttingOutcome> run();

 private:
  /// Gaps on the samples kept for the proof: with the angular zero as fitted, and found anew.
  struct Gap {
    double as_fitted_N = 0, rezeroed_N = 0;
  };

  /// Averages, and the model refitted without any effect; the error when they make no sense.
  std::optional<Error> calibrate();
  [[nodiscard]] bool cuts() const;
  [[nodiscard]] bool worth_a_look() const;
  [[nodiscard]] std::optional<Error> of_another_file() const;
  [[nodiscard]] std::optional<Error> of_exchanged_axes() const;
  void measure_again(const CutFit& fit);
  void calibrate_again(int rounds);
  [[nodiscard]] double depth_off() const;
  /// Than that of the file.
  [[nodiscard]] bool another_depth() const {
    return given_.cut.axial_depth_m != data_.cut.axial_depth_m;
  }
  /// The modes of the file do not show, and were left out.
  [[nodiscard]] bool without_structure() const {
    return given_.structure.x.size() + given_.structure.y.size() <
           data_.structure.x.size() + data_.structure.y.size();
  }
  [[nodiscard]] bool other_paths_fit(const CutFit& best);
  [[nodiscard]] LineSearch left_over(const CutFit& fit) const;
  void remove_lines();
  [[nodiscard]] bool may_chatter(double frequency_hz) const;
  void take_off_means(Column& force_N, std::size_t parts) const;
  /// Sets of effects, their fits, and the best that keeps the rules.
  struct Ranking {
    std::vector<std::vector<std::size_t>> sets;
    std::vector<CutFit> fits;
    std::vector<std::size_t> order;
    std::vector<std::string> objections;
    std::optional<std::size_t> best;
  };
  [[nodiscard]] std::string label_of(const Ranking& r, std::size_t i) const {
    return families_[r.sets[i].back()].info->name;
  }
  [[nodiscard]] Ranking rank_beside(const std::vector<std::size_t>& set, const CutFit& base,
                                    std::optional<std::size_t> without = {}) const;
  [[nodiscard]] RankedCandidate row_of(std::string name, const CutFit& fit, const CutFit& base,
                                       double worth, std::string objection) const;
  void look_without_structure();
  [[nodiscard]] bool stiff_tool_fits(CutFitter& stiff, CutFit& base) const;
  [[nodiscard]] CutState with_memory() const;
  bool begin_on_other_paths(const CutFit& best, std::vector<std::size_t>& set);
  bool not_of_the_cut(const CutFit& best, std::vector<std::size_t>& set, bool& paths_compared);
  bool take_pair(const Ranking& r, std::vector<std::size_t>& set);
  [[nodiscard]] std::string objection_to_best(const Ranking& r, double worth) const;
  void prune();
  void search();
  [[nodiscard]] bool clearly_better(const CutFit& its, const CutFit& than) const;
  [[nodiscard]] bool offset_shows(const CutFit& best) const;
  [[nodiscard]] CutFit with_offset(const CutFit& from) const;
  [[nodiscard]] bool tells_offset(const CutFit& fit) const;
  [[nodiscard]] std::optional<std::pair<CutFitter, CutFit>> filter_shows(const CutFit& best) const;
  void average_about(const std::vector<std::size_t>& set);
  void go_on_with(const std::vector<std::size_t>& set, CutFit its);
  void name_effects(Report& report);
  [[nodiscard]] FoundEffect described(std::size_t position, const CutFit& without) const;
  void prove(Report& report);
  void name_transients(Report& report);
  bool name_transient(Report& report, const CutTransients& transients);
  [[nodiscard]] CutTransients::Judged memory_in(const CutTransients& transients) const;
  [[nodiscard]] bool alike_in_passes(const CutTransients::Judged& its, double noise_N) const;
  static void add_mode_parameters(FoundEffect& effect, const CutTransients::Judged& its,
                                  double noise_N);
  static void add_vibration(Report& report, FoundEffect effect, std::array<double, 2> held,
                            const CutTransients& transients);
  void name_chatter(Report& report, const CutTransients& transients);
  [[nodiscard]] std::vector<ToothGain> tooth_gains(const CutFit& fit) const;
  void tell_what_is_unsteady(Report& report);
  [[nodiscard]] bool is_modulation(const CutTransients& transients, double share) const;
  void judge(Report& report) const;
  void report_lines(Report& report) const;
  [[nodiscard]] MeanTurn mean_turn() const;
  void testability(Report& report) const;
  [[nodiscard]] bool memory_shows() const;
  void maps(Report& report, const CutFit& before, const CutFit& after) const;
  void recalibrated(Report& report) const;
  [[nodiscard]] bool structure_doubted(const Report& report) const;
  void recorder_found(Report& report) const;
  void pictures(Report& report) const;

  /// Mean square beyond the noise of what a fit leaves, on the blocks fitted.
  [[nodiscard]] double beyond_noise(const CutFit& fit) const {
    return (fit.loss - average_.noise_N * average_.noise_N * cells_) / samples_;
  }
  /// rms that what is left must exceed to be a gap.
  [[nodiscard]] double floor_N() const;
  /// rms that an effect must take off to be named.
  [[nodiscard]] double least_gain() const;
  /// rms that noise does not take off.
  [[nodiscard]] double chance_gain() const;
  /// Share of what is beyond the noise for sure.
  [[nodiscard]] double explained(const CutFit& before, const CutFit& after) const;
  [[nodiscard]] std::vector<const Family*> chosen(const std::vector<std::size_t>& set) const;
  [[nodiscard]] CutFit fit(const std::vector<std::size_t>& set, const CutFit& from) const;
  [[nodiscard]] CutFit fit_afresh(const std::vector<std::size_t>& set) const;
  /// What was found, less one effect.
  [[nodiscard]] CutFit fit_without(std::size_t position) const;
  [[nodiscard]] std::vector<CutFit> fit_all(const std::vector<std::vector<std::size_t>>& sets,
                                            const CutFit& from) const;
  [[nodiscard]] bool compatible(const std::vector<std::size_t>& set, std::size_t more) const;
  [[nodiscard]] FittedEffect effect_of(const CutFit& fit, std::size_t position) const;
  [[nodiscard]] std::string objection(const CutFit& fit, std::size_t position) const;
  [[nodiscard]] std::string inconstancy(const CutFit& with, const CutFit& without) const;
  [[nodiscard]] double errors_between(const CutFit& worse, const CutFit& better) const;
  [[nodiscard]] std::vector<NamedValue> parameters(const CutFit& fit, std::size_t position,
                                                   bool errors) const;
  [[nodiscard]] Gap held_out_gap(const CutFit& fit) const;
  [[nodiscard]] Column predicted(const CutState& state, bool y) const;
  [[nodiscard]] Column predicted_at_samples(const CutState& state, bool y) const;
  [[nodiscard]] Problem map_problem(const CutFit& fit, Column& residual) const;

  CuttingData data_;  ///< lines fixed in time taken off as they are found
  const Options& options_;
  const Criteria& criteria_;
  CutAverage average_;
  std::optional<CutFitter> fitter_;
  CutState given_;
  double filter_hz_ = 0;  ///< of the recorder, where it shows
  std::vector<Family> families_;
  double cells_ = 0, samples_ = 0;
  CutFit base_, found_;
  std::vector<TimeLockedLine> lines_;
  bool moved_ = false;                    ///< the angular zero, for the end of the record
  std::optional<Modulation> modulation_;  ///< of the steady cut
  double unsteady_N_ = 0;                 ///< neither turns with the tool nor is noise
  bool unsteady_ = false;                 ///< by what has no name
  std::vector<RankedCandidate> ranking_;
  std::string why_nothing_;
};

}  // namespace servosense::reconcile
