// Shared by the stability charts: checks of what the user gave, and the oriented receptance.
#pragma once

#include <array>
#include <complex>
#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/identify/stability_lobes.hpp"

namespace servosense {

[[nodiscard]] std::optional<Error> refuse_cut(const MillingTool& tool, const MillingCut& cut);
/// Unequal pitch and process damping, which only semi-discretisation takes.
[[nodiscard]] std::optional<Error> refuse_beyond_zeroth_order(const MillingTool& tool);
[[nodiscard]] std::optional<Error> refuse_structure(const Structure& structure);
/// `what` as in "spindle speed", `unit` as in "rpm".
[[nodiscard]] std::optional<Error> refuse_axis(std::span<const double> values,
                                               const std::string& what, const std::string& unit);

/// Root of a function that changes sign between `low` and `high` (regula falsi, Illinois form,
/// with bisection when it stalls). Ends when the bracket is narrower than `tolerance` times its
/// upper end, or as narrow as doubles allow.
template <typename Function>
[[nodiscard]] double root_between(const Function& f, double low, double high,
                                  double tolerance = 0) {
  double f_low = f(low);
  double f_high = f(high);
  if (f_low == 0) return low;
  if (f_high == 0) return high;
  for (int i = 0; i < 200 && high - low > tolerance * high; ++i) {
    const bool bisect = i % 8 == 7;
    double middle = bisect ? 0.5 * (low + high) : high - f_high * (high - low) / (f_high - f_low);
    if (!(middle > low && middle < high)) middle = 0.5 * (low + high);
    if (middle <= low || middle >= high) break;
    const double f_middle = f(middle);
    if (f_middle == 0) return middle;
    if ((f_middle < 0) == (f_low < 0)) {
      low = middle;
      f_low = f_middle;
      f_high *= 0.5;  // keeps the far end from standing still
    } else {
      high = middle;
      f_high = f_middle;
      f_low *= 0.5;
    }
  }
  return 0.5 * (low + high);
}

/// Eigenvalues of alpha G(jw), followed over frequency.
class OrientedReceptance {
 public:
  using Eigenvalues = std::array<std::complex<double>, 2>;

  OrientedReceptance(const DirectionalCoefficients& alpha, Structure structure);
  OrientedReceptance(const DirectionalCoefficients& alpha, ToolTipReceptance receptance);

  /// Frequencies dense enough to follow the eigenvalues, and the eigenvalues there; entry r of
  /// each pair continues entry r of the one before.
  [[nodiscard]] const std::vector<double>& grid_rad_s() const { return grid_rad_s_; }
  [[nodiscard]] const std::vector<Eigenvalues>& on_grid() const { return on_grid_; }
  /// The eigenvalue at `omega_rad_s` that lies nearest to `neighbour`.
  [[nodiscard]] std::complex<double> near(double omega_rad_s, std::complex<double> neighbour) const;

 private:
  [[nodiscard]] Eigenvalues at(double omega_rad_s) const;
  void follow();

  DirectionalCoefficients alpha_;
  Structure structure_;
  ToolTipReceptance tables_;
  std::vector<double> grid_rad_s_;
  std::vector<Eigenvalues> on_grid_;
};

}  // namespace servosense
