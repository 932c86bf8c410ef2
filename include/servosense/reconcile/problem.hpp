// What the reconcile workflow compares, in plain data: a measured quantity, the terms that the
// model has, and the effects that might be missing. Drives and cuts bring their own physics and
// share everything from here on: floors, maps, ranking, decision, proof.
//
// Rows are samples, filtered and thinned out so that neighbours are nearly independent. Everything
// is a column over the rows:
//   target = sum coefficient * known term + sum coefficient * columns(theta) of candidates + noise
#pragma once

#include <cstddef>
#include <functional>
#include <span>
#include <string>
#include <vector>

namespace servosense::reconcile {

using Column = std::vector<double>;

/// A term that the model already has, refitted together with every candidate.
struct KnownTerm {
  std::string name;  ///< key of the machine file, or what it is ("timing", "backlash")
  Column column;
  double nominal = 0;        ///< coefficient in the machine file
  bool recalibrated = true;  ///< reported when it changes; false for mere nuisances
};

/// Something the residual may be a function of. A map of it is residual = f(values) * factor.
struct Coordinate {
  std::string name;  ///< "velocity", "position", "motor-angle", "tooth", "chip-thickness", ...
  std::string unit;
  Column values;
  Column factor;      ///< empty: 1. The direction, for friction along the stroke
  double period = 0;  ///< of values that come round; 0: they do not
  unsigned bins = 24;
};

/// A nonlinear parameter and where to look for it.
struct SearchRange {
  double low = 0;
  double high = 1;
  unsigned points = 12;
  bool logarithmic = true;
  double step = 0;  ///< first step of the refinement; 0: that of the grid
};

struct NamedValue {
  std::string key;
  std::vector<double> values;  ///< one, or a list
  std::string text{};          ///< instead of values: the name of a channel
};

/// What a fit means in physical parameters.
struct Meaning {
  std::vector<NamedValue> parameters;
  std::string violation;       ///< the rule of physics that it breaks; empty when it keeps them all
  std::string doubt{};         ///< what else it may be, unless it carries the gap; empty: nothing
  bool like_bristle = false;   ///< acts just after reversals, where friction laws differ
  double least_explained = 0;  ///< of what is beyond the noise; less may be another friction law
};

/// An effect that may be missing.
struct Candidate {
  std::string name;
  std::string scope = "machine";  ///< machine, power-up, tool or record
  std::string where;              ///< the coordinate in which it shows
  std::string splitting_motion;   ///< tells it from what it is confused with
  std::vector<SearchRange> search;
  /// Nonlinear parameters to start from instead of the grid, read off a residual (a spectrum's
  /// peaks). May return more values than `search` has ranges: the last range then serves them all.
  std::function<std::vector<std::vector<double>>(const Column& residual)> starts;
  /// Columns at the given nonlinear parameters; empty when they make no sense together.
  std::function<std::vector<Column>(std::span<const double> theta)> columns;
  /// The same, faster and less exact, to choose among the starts; empty: `columns`.
  std::function<std::vector<Column>(std::span<const double> theta)> coarse_columns;
  [[nodiscard]] std::vector<Column> at_start(std::span<const double> theta) const {
    return coarse_columns ? coarse_columns(theta) : columns(theta);
  }
  /// The nonlinear parameters make up for each other: they are refined together.
  bool coupled = false;
  /// Columns already have their physical size: their coefficient must come out near 1.
  bool sized = false;
  /// Has a memory of the motion: beside a larger effect it easily stands in for what friction laws
  /// and structure do that nobody writes down.
  bool memory = false;
  /// What its first parameter cannot be told from, in its unit: of backlash, travel within the
  /// presliding distance of friction. Part of its standard error.
  double resolution = 0;
  /// Not of the catalogue, ranked and never named: what it is. Empty for an effect.
  std::string rival;
  /// Acts by when the effort acts, so wherever that changes.
  bool timing = false;
  std::function<Meaning(std::span<const double> theta, std::span<const double> coefficients)>
      meaning;
  /// What of it this motion does not show, where it shows the rest, and what would; empty: nothing.
  std::string part_not_testable{}, part_would_need{};
  std::vector<std::string> equals;  ///< names that no motion of this drive could tell from it
  std::string not_testable;         ///< why this record cannot show it; empty when it can
  std::string refuted;              ///< by what it is known not to be the cause; empty: it may be
  std::string would_need;
};

struct Problem {
  std::string unit;  ///< of the target
  double row_period_s = 0;
  double noise_bandwidth_hz = 0;  ///< of the filter that target and columns went through
  Column time_s;
  Column target;
  std::vector<bool> usable;    ///< rows that count: in motion, without fault
  std::vector<bool> held_out;  ///< rows kept for the proof
  std::vector<KnownTerm> known;
  std::vector<Coordinate> coordinates;
  double encoder_floor = 0;  ///< what the encoder's noise leaves in the target, rms; 0: not known
  std::size_t lap_rows = 0;  ///< rows after which the motion repeats; 0: it does not

  [[nodiscard]] std::size_t rows() const { return target.size(); }
};

/// Noise floors, rms in the unit of the target.
struct Floors {
  double lap = 0;      ///< from repeated laps; 0 when there are none
  double local = 0;    ///< from the upper half of the band
  double encoder = 0;  ///< from the encoder's noise; 0 where it is not known
  double used = 0;     ///< the smallest credible one, and no less than the encoder's
};

}  // namespace servosense::reconcile
