#include "servosense/identify/load_meter.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "dsp/dense.hpp"

namespace servosense {
namespace {

constexpr double kTwoSpeeds = 1.2;  // ratio from which on speeds count as two: a convention
constexpr double kExact = 1e-9;     // of the highest volts: less than sums of doubles leave

}  // namespace

Expected<LoadMeter> calibrate_load_meter(const std::vector<LoadMeterPoint>& points) {
  std::vector<LoadMeterPoint> used;
  double slowest = 0, fastest = 0, highest = 0;
  bool cut = false;
  for (const LoadMeterPoint& p : points) {
    if (!(p.speed_rad_s >= rad_s_from_rpm(kLoadMeterFrom_rpm) * 0.999)) continue;
    used.push_back(p);
    highest = std::max(highest, std::abs(p.volts));
    cut = cut || p.torque_Nm > 0;
    if (p.torque_Nm > 0) continue;
    slowest = slowest > 0 ? std::min(slowest, p.speed_rad_s) : p.speed_rad_s;
    fastest = std::max(fastest, p.speed_rad_s);
  }
  if (!(slowest > 0 && fastest >= kTwoSpeeds * slowest))
    return data_error(
        "the load meter's friction is a line over the speed; record air at two speeds or more "
        "above "
        "2000 rpm, up to the highest");
  if (!cut)
    return data_error(
        "nothing tells the volts per watt; record cuts above 2000 rpm whose torque is measured, "
        "too "
        "(tool.torque_Nm)");
  const auto rows = static_cast<Eigen::Index>(used.size());
  Eigen::MatrixXd design(rows, 3);
  Eigen::VectorXd values(rows);
  for (Eigen::Index r = 0; r < rows; ++r) {
    const LoadMeterPoint& p = used[static_cast<std::size_t>(r)];
    const double error = std::max(p.volts_error, kExact * highest);
    design.row(r) << p.torque_Nm * p.speed_rad_s, p.speed_rad_s * p.speed_rad_s, p.speed_rad_s;
    design.row(r) /= error;
    values[r] = p.volts / error;
  }
  const Eigen::Vector3d scale = design.colwise().norm().transpose();
  design *= scale.cwiseInverse().asDiagonal();
  if (dense::rank(design) < 3)
    return data_error("air and cuts do not differ enough in speed and torque; record more of both");
  const Eigen::Vector3d found = dense::least_squares(design, values);
  LoadMeter meter;
  if (rows > 3)
    meter.misfit = (values - design * found).norm() / std::sqrt(static_cast<double>(rows - 3));
  const Eigen::Matrix3d inverse = (design.transpose() * design).inverse();
  const Eigen::Matrix3d covariance = std::max(1.0, meter.misfit * meter.misfit) *
                                     scale.cwiseInverse().asDiagonal() * inverse *
                                     scale.cwiseInverse().asDiagonal();
  const Eigen::Vector3d k = found.cwiseQuotient(scale);
  if (!(k[0] > 0))
    return data_error("the load does not grow with the torque of the cuts; check both columns");
  const auto ratio = [&](Eigen::Index i) {
    const double r = k[i] / k[0];
    const double variance = covariance(i, i) - 2 * r * covariance(i, 0) + r * r * covariance(0, 0);
    return Estimate{r, std::sqrt(std::max(0.0, variance)) / k[0]};
  };
  meter.volts_per_watt = {k[0], std::sqrt(covariance(0, 0))};
  meter.viscous_Nm_s_per_rad = ratio(1);
  meter.constant_Nm = ratio(2);
  return meter;
}

}  // namespace servosense
