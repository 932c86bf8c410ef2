// Means of cuts and of air as equations for the cutting coefficients, and their least squares.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "servosense/identify/cutting.hpp"

namespace servosense::cutting_rows {

/// Slower, an axis counts as standing [m/s]: a convention, 18 mm/min.
constexpr double kStill_m_s = 3e-4;
/// How well the friction that a file has is known, of it: a convention (Koike 2016, fig. 4-24, saw
/// it change by more with temperature: record some air).
constexpr double kFrictionKnown = 0.1;

/// Tangential, its edge, radial, its edge, axial, its edge.
constexpr std::size_t kCoefficients = 6;
using Shares = std::array<double, kCoefficients>;
using Wanted = std::array<bool, kCoefficients>;

/// Something that is unknown beside the coefficients, and what of it is in a row.
struct OffsetShare {
  std::size_t offset = 0;
  double share = 1;
};

/// value = shares . coefficients + offsets, within `error`.
struct Row {
  double value = 0, error = 0;
  Shares shares{};
  std::vector<OffsetShare> offsets;
};

struct Equations {
  std::vector<Row> rows;
  std::size_t offsets = 0;
  double friction = 0;  ///< the largest uncertainty of friction, less what the air tells
  std::vector<std::string> trusted;  ///< of what without air the file alone is believed
};

/// Which signals of a record.
struct Sensor {
  std::string name;             ///< for a reader
  std::vector<std::string> of;  ///< names of the signals
};

[[nodiscard]] Equations equations(const Sensor& sensor, const CutGeometry& geometry,
                                  const std::vector<CuttingRecord>& records,
                                  const std::vector<FoundCut>& cuts);

/// Coefficients with their covariance, those that are held among them.
struct Solution {
  Eigen::Matrix<double, kCoefficients, 1> value = Eigen::Matrix<double, kCoefficients, 1>::Zero();
  Eigen::Matrix<double, kCoefficients, kCoefficients> covariance =
      Eigen::Matrix<double, kCoefficients, kCoefficients>::Zero();
  double misfit = 0;  ///< square root of chi square per degree of freedom; 0: no freedom is left

  [[nodiscard]] Estimate at(std::size_t c) const;
  /// Of coefficient `a` over `b`.
  [[nodiscard]] Estimate ratio(std::size_t a, std::size_t b) const;
};

/// Weighted least squares for what is `wanted`; the others are as in `held`, with its covariance.
/// The covariance grows by chi square where the rows disagree by more than their errors. Nothing
/// when the rows cannot tell one of them.
[[nodiscard]] std::optional<Solution> solve(const Equations& equations, const Wanted& wanted,
                                            const Solution& held = {});

}  // namespace servosense::cutting_rows
