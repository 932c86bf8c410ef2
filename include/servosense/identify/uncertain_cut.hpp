// A milling cut of which tool and structure are known with errors, and what one believes of them.
//
// Unknown are the tangential coefficient, the radial ratio, and frequency, damping and mass of
// every mode: theta = (ln Kt, c, ln f, ln zeta, ln m, ...), normally distributed about the values
// of the file, theta = middle + spread z with z standard normal. Logarithms, because standard
// errors are relative and the numbers are positive. A belief is a set of equally likely z: at first
// drawn from that normal distribution, then changed by cuts that were watched
// (identify/watched_cuts.hpp).
//
// Errors that nobody states are taken from typical_error below, each with its kind and source.
#pragma once

#include <Eigen/Dense>
#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/model/milling.hpp"
#include "servosense/model/structural_mode.hpp"

namespace servosense {

/// Standard errors where none are stated. Kind and source:
namespace typical_error {
/// Of the tangential coefficient, of it. Published: from load meter and from dynamometer it
/// differed by 11 % (Dunwoody 2010, eq. 3.20 and 3.22).
inline constexpr double kTangential = 0.11;
/// Of the radial ratio. Published: 0.25 to 0.5 in use where it is not identified (Dunwoody 2010,
/// section 6.3), as a uniform distribution.
inline constexpr double kRadialRatio = 0.072;
/// Of frequency, damping ratio and mass of a mode, of them. Chosen: a hand-held hammer, tool taken
/// out and put back, spindle at rest where the cut turns it.
inline constexpr std::array<double, 3> kMode = {0.01, 0.2, 0.15};
/// Of the offset of the tool axis in each direction [m]. Chosen: collets of the common class.
inline constexpr double kOffset_m = 5e-6;
}  // namespace typical_error

/// What is believed of a tool at whose structure nobody has looked: one mode in each direction.
/// Chosen, so that two standard deviations hold the tools of Insperger and Stepan 2004 (922 Hz,
/// 0.011, 1.3 MN/m), Koike 2016 (2082 Hz, 0.018, 7.4 MN/m) and Dunwoody 2010 (20 MN/m, 0.03) well
/// inside. The two directions of a tool that turns are alike.
namespace unknown_structure {
struct Lognormal {
  double median, deviation;  ///< deviation of the logarithm
};
inline constexpr Lognormal kFrequency_hz{1000, 0.6}, kDamping{0.025, 0.5},
    kStiffness_N_per_m{8e6, 0.9};
inline constexpr double kFrequencyBetween = 0.1, kDampingBetween = 0.3, kStiffnessBetween = 0.3;
}  // namespace unknown_structure

/// What could be measured, and which parameters that would tell.
enum class Measurement {
  feeds,   ///< cuts at several feeds: the tangential coefficient
  forces,  ///< forces in two directions: the radial ratio
  hits_x,  ///< hammer along x
  hits_y,  ///< hammer along y
};

struct UncertainParameter {
  std::string name;  ///< as in the machine file
  Measurement told_by = Measurement::feeds;
};

/// Standard errors as stated: tangential coefficient relative, radial ratio absolute, modes
/// relative (frequency, damping ratio, mass), one triple a mode of `structure`.
struct CutErrors {
  double tangential = typical_error::kTangential;
  double radial_ratio = typical_error::kRadialRatio;
  std::vector<std::array<double, 3>> x, y;
  double offset_m = typical_error::kOffset_m;
};

class UncertainCut {
 public:
  /// Errors: as SemiDiscretization::create; a number of triples that is not that of the modes; an
  /// error that is negative or not finite.
  static Expected<UncertainCut> create(const Structure& structure, const MillingTool& tool,
                                       const MillingCut& cut, const CutErrors& errors);
  /// With the structure of unknown_structure.
  static Expected<UncertainCut> without_structure(const MillingTool& tool, const MillingCut& cut,
                                                  const CutErrors& errors);

  struct Possible {
    Structure structure;
    MillingTool tool;
  };
  /// Tool and structure at z, size() numbers.
  [[nodiscard]] Possible at(const Eigen::Ref<const Eigen::VectorXd>& z) const;
  [[nodiscard]] Eigen::Index size() const { return spread_.cols(); }
  [[nodiscard]] const std::vector<UncertainParameter>& parameters() const { return parameters_; }
  /// theta = middle + spread() z, in the order of parameters().
  [[nodiscard]] const Eigen::MatrixXd& spread() const { return spread_; }
  [[nodiscard]] const MillingTool& tool() const { return tool_; }
  [[nodiscard]] const MillingCut& cut() const { return cut_; }
  [[nodiscard]] const Structure& structure() const { return structure_; }
  [[nodiscard]] double offset_error_m() const { return offset_m_; }
  [[nodiscard]] bool structure_is_unknown() const { return unknown_; }

 private:
  Structure structure_;
  MillingTool tool_;
  MillingCut cut_;
  Eigen::MatrixXd spread_;
  std::vector<UncertainParameter> parameters_;
  double offset_m_ = 0;
  bool unknown_ = false;
};

/// Equally likely z, a column each.
using CutBelief = Eigen::MatrixXd;

/// `count` points of the normal distribution, more evenly spread than independent ones (Roberts
/// 2018, additive recurrence, shifted at random by `seed`).
[[nodiscard]] CutBelief prior_belief(const UncertainCut& cut, Eigen::Index count,
                                     std::uint64_t seed = 1);

/// The belief if theta of all parameters with `known[i]` were known to be what is now their mean,
/// by the linear rule of normal distributions: z moves along with what it is correlated with.
[[nodiscard]] CutBelief belief_if_known(const UncertainCut& cut, const CutBelief& belief,
                                        const std::vector<bool>& known);

}  // namespace servosense
