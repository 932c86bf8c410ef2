// Refits of a whole cut: what the model has wrong, and the candidates for what it lacks, together.
#pragma once

#include <Eigen/Dense>
#include <algorithm>
#include <string>
#include <vector>

#include "reconcile/cut/average.hpp"
#include "reconcile/cut/force_model.hpp"
#include "servosense/core/units.hpp"
#include "servosense/model/cutting_effects.hpp"
#include "servosense/reconcile/criteria.hpp"
#include "servosense/reconcile/problem.hpp"

namespace servosense::reconcile {

/// A number that a fit may move, and what it does to the cut.
struct Unknown {
  enum class Kind {
    zero,
    immersion,
    lag,
    helix,
    exponent,
    throw_x,  ///< of the tool axis, in feeds per tooth
    throw_y,
    shorter,    ///< one tooth, in feeds per tooth
    broken,     ///< one tooth, of the depth
    pitch,      ///< one tooth
    sensor_hz,  ///< logarithm
    sensor_damping,
    mode_hz,
    mode_damping,
    mode_mass,
    damping,   ///< of the process: Cp in mm of Kt
    offset_x,  ///< of the sensor [N]
    offset_y,
  };
  Kind kind = Kind::zero;
  std::size_t index = 0;  ///< tooth, or axis of a mode: 0 x, 1 y
  double low = 0, high = 0;
  double small = 1e-3;  ///< change for derivatives
};

/// Resonances are searched up to this many times the highest frequency that the samples show.
inline constexpr double kBeyondBand = 1.5;

/// One way an effect may show. Several families may share a name.
struct Family {
  const CuttingEffectInfo* info = nullptr;
  std::vector<Unknown> unknowns{};
  std::vector<std::vector<double>> starts{};
  bool edges = false;
  std::size_t tooth = 0;
  std::string twin{};  ///< families of the same twin exclude each other
  bool regeneration = false;
  /// Whether there is anything to start a fit from: no mode may take off any of what is left.
  [[nodiscard]] bool startable() const { return unknowns.empty() || !starts.empty(); }
};

/// A cut fitted with some families.
struct CutFit {
  std::vector<std::size_t> families;
  std::vector<std::vector<double>> own;  ///< values of each family
  std::vector<std::size_t> first;        ///< of each family in `values`
  std::vector<Unknown> unknowns;         ///< nuisances first, then those of the families
  std::vector<double> values;
  CutState state;                     ///< at the values, coefficients included
  std::vector<Eigen::VectorXd> bins;  ///< forces of every level
  Eigen::VectorXd coefficient_errors;
  std::vector<double> value_errors;
  /// By how much all else that is free makes each of these larger.
  std::vector<double> inflations;
  double loss = 1e300;             ///< sum of squares of the blocks fitted
  std::vector<double> block_loss;  ///< of each block, held out or not
};

class CutFitter {
 public:
  CutFitter(const CutAverage& average, CutState given, double feed_m, const Criteria& criteria);

  /// After the averages have changed.
  void refresh();
  /// Zero, signs and nuisances of the model as given; throws or edges that the file has are
  /// refitted. The averages are of plain samples, so that a bin smears what it holds.
  CutFit calibrate(bool channel_is_tool);
  /// Again, from an earlier one, with samples averaged about it.
  CutFit calibrate(const CutFit& from);
  /// With these families, started from the values of `from` where it has them.
  [[nodiscard]] CutFit fit(const std::vector<const Family*>& families,
                           const std::vector<std::size_t>& indices, const CutFit& from) const;
  /// From the best start alone, in a few rounds: enough to see which of several may matter.
  [[nodiscard]] CutFit fit_coarsely(const std::vector<const Family*>& families,
                                    const std::vector<std::size_t>& indices,
                                    const CutFit& from) const;
  /// As `fit`, choosing anew whether samples are values or means: what was missing hid it.
  [[nodiscard]] CutFit fit_again(const std::vector<const Family*>& families,
                                 const std::vector<std::size_t>& indices, CutFit from) const;
  [[nodiscard]] std::vector<Family> families(const CutFit& base) const;
  /// The same with the other paths of the teeth: trochoids or circles.
  CutFit calibrate_other_paths(const CutFit& from);
  /// The same with this structure, remembered or not.
  CutFit calibrate_with(const Structure& structure, bool regeneration, CutFit from);
  /// The same with another axial depth.
  CutFit calibrate_deeper(double scale, CutFit from);
  /// The same behind a filter of the recorder.
  CutFit calibrate_filtered(CutFit from, double filter_hz);
  /// The offset of the sensor as a candidate, and as something that all fits have.
  [[nodiscard]] static Family offset();
  void always_with_offset() { with_offset_ = true; }
  [[nodiscard]] bool has_offset() const { return with_offset_; }
  [[nodiscard]] bool circular_paths() const { return given_.circular_paths; }

  /// Teeth enter or leave the cut within two samples.
  [[nodiscard]] bool steep() const;
  [[nodiscard]] CutState state_at(const std::vector<Unknown>& unknowns,
                                  const std::vector<double>& values, bool edges) const;
  [[nodiscard]] std::vector<Eigen::VectorXd> forces(const CutState& state) const;

  // What the effects of the table (effects.hpp) ask.
  [[nodiscard]] const CutState& given() const { return given_; }
  [[nodiscard]] const Criteria& criteria() const { return criteria_; }
  /// The model has it, and all fits refit it.
  [[nodiscard]] bool has(Unknown::Kind kind) const {
    return std::any_of(nuisances_.begin(), nuisances_.end(),
                       [&](const Unknown& u) { return u.kind == kind; });
  }
  /// The file has modes that vibrate, and says that the chip does not remember it.
  [[nodiscard]] bool forced_only() const {
    return !given_.cut.regeneration && !(given_.structure.x.empty() && given_.structure.y.empty());
  }
  void add_sensor_resonance(const CutFit& base, std::vector<Family>& all) const;
  void add_modes(const CutFit& base, std::vector<Family>& all) const;

 private:
  struct Trial;
  /// What is free in a fit, and from where.
  struct Plan {
    std::vector<Unknown> unknowns;  ///< nuisances first, then those of the families
    std::size_t first_of_families = 0;
    std::vector<std::vector<double>> starts;
    CutState about;
    bool edges = false;
    double zero_rad = 0;  ///< as known before
  };
  [[nodiscard]] Plan plan(const std::vector<const Family*>& families,
                          const std::vector<std::size_t>& indices, const CutFit& from) const;
  [[nodiscard]] std::vector<Trial> best_starts(const Plan& plan, std::size_t most) const;
  [[nodiscard]] CutFit fitted(const Trial& best, const Plan& plan,
                              const std::vector<const Family*>& families,
                              const std::vector<std::size_t>& indices) const;
  /// `alike`: its columns are those of the values.
  [[nodiscard]] Trial evaluate(const std::vector<Unknown>& unknowns,
                               const std::vector<double>& values, bool edges, const CutState& about,
                               const Trial* alike = nullptr) const;
  void descend(Trial& best, const std::vector<Unknown>& unknowns, bool edges, int rounds) const;
  /// To the least that is near; `known_zero_rad`: as found for the same samples before.
  void refine(Trial& best, const std::vector<Unknown>& unknowns, bool edges,
              double known_zero_rad) const;
  [[nodiscard]] CutFit finished(const Trial& trial, const std::vector<Unknown>& unknowns,
                                bool edges) const;
  CutFit settle(const Trial& about, double smeared_rad);
  void add_nuisances();
  [[nodiscard]] Eigen::MatrixXd columns_over_bins(const CutState& state,
                                                  const CutLevel& level) const;
  [[nodiscard]] Eigen::VectorXd offset_of(const CutState& state) const;
  [[nodiscard]] double tooth_period() const;
  [[nodiscard]] double sample_rad() const;
  [[nodiscard]] double bin_rad() const { return kTwoPi / static_cast<double>(average_.bins); }
  /// Forces step within a bin, and nothing smooths them.
  [[nodiscard]] bool steps_in(const CutState& state) const { return steep() && !rings(state); }
  struct Scan {
    double lowest_hz = 0, highest_hz = 0;
    std::vector<double> frequencies_hz;
  };
  [[nodiscard]] Scan scan() const;

  const CutAverage& average_;
  CutState given_;
  double feed_m_;
  const Criteria& criteria_;
  bool with_offset_ = false;
  std::vector<Unknown> nuisances_;
  std::vector<double> nuisance_values_;
  std::vector<Eigen::VectorXd> mean_, weight_;  // of the levels, blocks not held out
};

}  // namespace servosense::reconcile
