#include "servosense/identify/stability_lobes.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "servosense/dsp/golden_section.hpp"
#include "stability_loop.hpp"

namespace servosense {
namespace {

using Complex = std::complex<double>;
constexpr double kInfinite = std::numeric_limits<double>::infinity();
constexpr double kNotANumber = std::numeric_limits<double>::quiet_NaN();

/// Where a function of one variable has its largest value.
template <typename Function>
double highest_between(const Function& f, double low, double high) {
  // A flat top hides differences below sqrt(epsilon); narrowing further finds only rounding.
  return lowest_between([&](double x) { return -f(x); }, low, high,
                        [](double from, double to) { return !(to - from > 1e-9 * to); });
}

std::optional<Error> refuse_table(const ReceptanceTable& table, const char* name) {
  const std::size_t n = table.frequency_hz.size();
  const std::string which = std::string("The receptance table ") + name;
  if (n != table.receptance_m_per_N.size())
    return data_error(which + " has " + std::to_string(n) + " frequencies but " +
                      std::to_string(table.receptance_m_per_N.size()) + " values.");
  if (n == 1) return data_error(which + " has one line only: give at least two frequencies.");
  for (std::size_t i = 0; i < n; ++i) {
    if (!std::isfinite(table.frequency_hz[i]) || table.frequency_hz[i] < 0 ||
        !std::isfinite(table.receptance_m_per_N[i].real()) ||
        !std::isfinite(table.receptance_m_per_N[i].imag()))
      return data_error(which + " has an invalid value in line " + std::to_string(i + 1) + ".");
    if (i > 0 && table.frequency_hz[i] <= table.frequency_hz[i - 1])
      return data_error(which + " must have rising frequencies: line " + std::to_string(i + 1) +
                        " does not rise.");
  }
  return std::nullopt;
}

/// Sorted, disjoint, clipped to from..to.
/// A pocket is at least this much deeper than what is stable at every speed.
constexpr double kLeastGain = 1.01;

std::vector<SpeedInterval> united(std::vector<SpeedInterval> parts, double from_rpm,
                                  double to_rpm) {
  std::erase_if(parts,
                [&](const SpeedInterval& p) { return p.to_rpm < from_rpm || p.from_rpm > to_rpm; });
  std::sort(parts.begin(), parts.end(),
            [](const auto& a, const auto& b) { return a.from_rpm < b.from_rpm; });
  std::vector<SpeedInterval> whole;
  for (const SpeedInterval& p : parts) {
    const SpeedInterval clipped{std::max(p.from_rpm, from_rpm), std::min(p.to_rpm, to_rpm)};
    if (!whole.empty() && clipped.from_rpm <= whole.back().to_rpm)
      whole.back().to_rpm = std::max(whole.back().to_rpm, clipped.to_rpm);
    else
      whole.push_back(clipped);
  }
  return whole;
}

std::vector<double> ratios_between(double low, double high, int count) {
  std::vector<double> ratios;
  const int steps = low == high ? 0 : std::max(count, 2) - 1;
  for (int i = 0; i <= steps; ++i)
    ratios.push_back(steps == 0 ? low : low + (high - low) * i / steps);
  return ratios;
}

/// One chart for each radial ratio.
Expected<std::vector<StabilityLobes>> charts_over(const Structure& structure, MillingTool tool,
                                                  const MillingCut& cut, double ratio_low,
                                                  double ratio_high, int ratios) {
  if (!(ratio_low >= 0 && ratio_low <= ratio_high) || !std::isfinite(ratio_high))
    return usage_error("The range of the radial ratio must rise from zero or more.");
  std::vector<StabilityLobes> charts;
  for (const double ratio : ratios_between(ratio_low, ratio_high, ratios)) {
    tool.force.radial_ratio = ratio;
    auto chart = StabilityLobes::from_modes(structure, tool, cut);
    if (!chart) return chart.error();
    charts.push_back(std::move(*chart));
  }
  return charts;
}

}  // namespace

Expected<StabilityLobes> StabilityLobes::from_modes(const Structure& structure,
                                                    const MillingTool& tool,
                                                    const MillingCut& cut) {
  if (auto error = refuse_cut(tool, cut)) return *error;
  if (auto error = refuse_beyond_zeroth_order(tool)) return *error;
  if (auto error = refuse_structure(structure)) return *error;
  const auto alpha = engagement_integral(engagement_of(tool, cut), tool.force.radial_ratio);
  return StabilityLobes(std::make_shared<const OrientedReceptance>(alpha, structure), tool);
}

Expected<StabilityLobes> StabilityLobes::from_receptance(const ToolTipReceptance& receptance,
                                                         const MillingTool& tool,
                                                         const MillingCut& cut) {
  if (auto error = refuse_cut(tool, cut)) return *error;
  if (auto error = refuse_beyond_zeroth_order(tool)) return *error;
  if (auto error = refuse_table(receptance.xx, "xx")) return *error;
  if (auto error = refuse_table(receptance.yy, "yy")) return *error;
  if (auto error = refuse_table(receptance.xy, "xy")) return *error;
  if (auto error = refuse_table(receptance.yx, "yx")) return *error;
  if (receptance.xx.frequency_hz.empty() && receptance.yy.frequency_hz.empty())
    return data_error("There is no receptance: give the table xx, yy or both.");
  const auto alpha = engagement_integral(engagement_of(tool, cut), tool.force.radial_ratio);
  auto loop = std::make_shared<const OrientedReceptance>(alpha, receptance);
  if (loop->grid_rad_s().size() < 2)
    return data_error("The receptance tables have no frequency range in common.");
  return StabilityLobes(std::move(loop), tool);
}

StabilityLobes::StabilityLobes(std::shared_ptr<const OrientedReceptance> loop,
                               const MillingTool& tool)
    : loop_(std::move(loop)),
      teeth_(tool.teeth),
      depth_scale_(kTwoPi / (tool.teeth * tool.force.tangential_coefficient_N_per_m2)) {
  const auto& w = loop_->grid_rad_s();
  const auto& values = loop_->on_grid();
  for (std::size_t branch = 0; branch < 2; ++branch) {
    Piece line;
    for (std::size_t i = 0; i < w.size(); ++i) line.push_back(node(w[i], values[i][branch]));
    const auto real_at = [&](std::size_t i) { return line[i].lambda.real(); };
    Piece piece;
    const auto close = [&] {
      if (piece.size() > 1) pieces_.push_back(piece);
      piece.clear();
    };
    for (std::size_t i = 0; i < line.size(); ++i) {
      if (i > 0 && (real_at(i) > 0) != (real_at(i - 1) > 0)) {
        const double edge = root_between(
            [&](double x) { return node_between(line[i - 1], line[i], x).lambda.real(); }, w[i - 1],
            w[i]);
        Node end = node_between(line[i - 1], line[i], edge);
        end.depth_m = kInfinite;
        piece.push_back(end);
        if (real_at(i) <= 0) close();
      }
      if (real_at(i) > 0) piece.push_back(line[i]);
      if (i == 0 || i + 1 == line.size() || !(real_at(i) > 0)) continue;
      // The exact top or valley of Re lambda makes depth monotonic between neighbouring nodes.
      const bool top = real_at(i) >= real_at(i - 1) && real_at(i) > real_at(i + 1);
      const bool valley = real_at(i) < real_at(i - 1) && real_at(i) <= real_at(i + 1);
      if (!top && !valley) continue;
      const double sign = top ? 1 : -1;
      const auto height = [&](double x) {
        const bool left = x < w[i];
        return sign * node_between(line[left ? i - 1 : i], line[left ? i : i + 1], x).lambda.real();
      };
      const double at = highest_between(height, w[i - 1], w[i + 1]);
      const bool left = at < w[i];
      const Node extreme = node_between(line[left ? i - 1 : i], line[left ? i : i + 1], at);
      if (left) {  // before the grid point that is already there
        piece.insert(piece.end() - 1, extreme);
        if (valley) {
          const Node again = piece.back();
          piece.pop_back();
          close();
          piece = {extreme, again};
        }
      } else {
        piece.push_back(extreme);
        if (valley) {
          close();
          piece = {extreme};
        }
      }
    }
    close();
  }
}

StabilityLobes::Node StabilityLobes::node(double omega_rad_s, Complex lambda) const {
  const double re = lambda.real();
  return {omega_rad_s, lambda, kPi + 2 * std::arg(lambda), re > 0 ? depth_scale_ / re : kInfinite};
}

StabilityLobes::Node StabilityLobes::node_between(const Node& left, const Node& right,
                                                  double omega_rad_s) const {
  const double share = (omega_rad_s - left.omega_rad_s) / (right.omega_rad_s - left.omega_rad_s);
  return node(omega_rad_s,
              loop_->near(omega_rad_s, (1 - share) * left.lambda + share * right.lambda));
}

StabilityLobes::Contact StabilityLobes::contact_at(double spindle_speed_rpm) const {
  const double period = 60 / (teeth_ * spindle_speed_rpm);
  Contact best;
  best.depth_m = kInfinite;
  for (std::size_t p = 0; p < pieces_.size(); ++p) {
    const Piece& piece = pieces_[p];
    const auto waves = [period](const Node& n) {
      return (n.omega_rad_s * period - n.phase_rad) / kTwoPi;
    };
    double right_waves = waves(piece[0]);
    for (std::size_t i = 1; i < piece.size(); ++i) {
      const double left_waves = right_waves;
      right_waves = waves(piece[i]);
      const Node& left = piece[i - 1];
      const Node& right = piece[i];
      if (std::min(left.depth_m, right.depth_m) >= best.depth_m) continue;  // cannot be lower
      const double first = std::max(0.0, std::ceil(std::min(left_waves, right_waves)));
      const double last = std::floor(std::max(left_waves, right_waves));
      if (first > last) continue;
      // The depth falls from one node to the other: the lobe nearest to the lower one is lowest.
      const double k = (left.depth_m < right.depth_m) == (left_waves < right_waves) ? first : last;
      const double w = root_between(
          [&](double x) {
            return x * period - node_between(left, right, x).phase_rad - kTwoPi * k;
          },
          left.omega_rad_s, right.omega_rad_s);
      const Node here = node_between(left, right, w);
      if (here.depth_m < best.depth_m)
        best = {static_cast<int>(p), static_cast<int>(k), w, here.depth_m};
    }
  }
  return best;
}

LobePoint StabilityLobes::limit_at(double spindle_speed_rpm) const {
  const Contact c = contact_at(spindle_speed_rpm);
  return {spindle_speed_rpm, c.depth_m, c.piece < 0 ? kNotANumber : c.omega_rad_s / kTwoPi};
}

Expected<std::vector<LobePoint>> StabilityLobes::envelope(
    std::span<const double> spindle_speed_rpm) const {
  if (auto error = refuse_axis(spindle_speed_rpm, "spindle speed", "rpm")) return *error;
  std::vector<LobePoint> points;
  points.reserve(spindle_speed_rpm.size());
  for (const double speed : spindle_speed_rpm) points.push_back(limit_at(speed));
  return points;
}

std::vector<LobeCurve> StabilityLobes::lobes(int first, int last) const {
  std::vector<LobeCurve> curves;
  for (int k = std::max(first, 0); k <= last; ++k)
    for (const Piece& piece : pieces_) {
      LobeCurve curve{k, {}};
      for (const Node& n : piece)
        if (std::isfinite(n.depth_m))
          curve.points.push_back({60 * n.omega_rad_s / (teeth_ * (n.phase_rad + kTwoPi * k)),
                                  n.depth_m, n.omega_rad_s / kTwoPi});
      curves.push_back(std::move(curve));
    }
  return curves;
}

LobePoint StabilityLobes::minimum(int lobe) const {
  LobePoint lowest{kNotANumber, kInfinite, kNotANumber};
  for (const Piece& piece : pieces_)
    for (const Node& n : piece)
      if (n.depth_m < lowest.axial_depth_m)
        lowest = {60 * n.omega_rad_s / (teeth_ * (n.phase_rad + kTwoPi * lobe)), n.depth_m,
                  n.omega_rad_s / kTwoPi};
  return lowest;
}

void StabilityLobes::find_jumps(double low_rpm, const Contact& low, double high_rpm,
                                const Contact& high, std::vector<StabilityPocket>& found) const {
  if (low.piece == high.piece && low.lobe == high.lobe) return;
  const double middle = 2 / (1 / low_rpm + 1 / high_rpm);
  if (high_rpm - low_rpm > 1e-12 * high_rpm && middle > low_rpm && middle < high_rpm) {
    const Contact between = contact_at(middle);
    find_jumps(low_rpm, low, middle, between, found);
    find_jumps(middle, between, high_rpm, high, found);
    return;
  }
  // A pocket if the envelope falls on both sides; otherwise one lobe dives below another.
  const double top = std::max(low.depth_m, high.depth_m);
  if (contact_at(low_rpm * (1 - 1e-7)).depth_m < top &&
      contact_at(high_rpm * (1 + 1e-7)).depth_m < top)
    found.push_back({middle, std::min(low.depth_m, high.depth_m), low.omega_rad_s / kTwoPi,
                     high.omega_rad_s / kTwoPi});
}

std::vector<StabilityPocket> StabilityLobes::pockets(double from_rpm, double to_rpm) const {
  std::vector<StabilityPocket> found;
  if (pieces_.empty() || !(from_rpm > 0 && from_rpm < to_rpm)) return found;
  // Slow lobes are so close that nothing is gained between them.
  const auto covered = unstable_speeds(kLeastGain * minimum().axial_depth_m, from_rpm, to_rpm);
  if (!covered.empty() && covered.front().from_rpm <= from_rpm) from_rpm = covered.front().to_rpm;
  if (!(from_rpm < to_rpm)) return found;
  double highest = 0;  // of the frequencies at which lobes have their bottoms
  for (const Piece& piece : pieces_) {
    const auto bottom =
        std::min_element(piece.begin(), piece.end(),
                         [](const auto& a, const auto& b) { return a.depth_m < b.depth_m; });
    highest = std::max(highest, bottom->omega_rad_s);
  }
  // Lobes are equally wide in tooth period: 16 looks at each of the narrowest.
  const double longest = 60 / (teeth_ * from_rpm);
  const double shortest = 60 / (teeth_ * to_rpm);
  const int looks = 16 + static_cast<int>(16 * highest * (longest - shortest) / kTwoPi);
  double low_rpm = from_rpm;
  Contact low = contact_at(low_rpm);
  for (int i = 1; i <= looks; ++i) {
    const double high_rpm = 60 / (teeth_ * (longest + (shortest - longest) * i / looks));
    const Contact high = contact_at(high_rpm);
    find_jumps(low_rpm, low, high_rpm, high, found);
    low_rpm = high_rpm;
    low = high;
  }
  return found;
}

std::vector<SpeedInterval> StabilityLobes::unstable_speeds(double axial_depth_m, double from_rpm,
                                                           double to_rpm) const {
  std::vector<SpeedInterval> parts;
  for (const Piece& piece : pieces_) {
    // The stretch of the curve below the depth; a piece has one bottom, so it is in one part.
    Piece stretch;
    for (std::size_t i = 0; i < piece.size(); ++i) {
      const bool below = piece[i].depth_m < axial_depth_m;
      if (i > 0 && below != (piece[i - 1].depth_m < axial_depth_m)) {
        const double wanted = depth_scale_ / axial_depth_m;
        const double w = root_between(
            [&](double x) {
              return node_between(piece[i - 1], piece[i], x).lambda.real() - wanted;
            },
            piece[i - 1].omega_rad_s, piece[i].omega_rad_s);
        stretch.push_back(node_between(piece[i - 1], piece[i], w));
      }
      if (below) stretch.push_back(piece[i]);
    }
    if (stretch.size() < 2) continue;
    const auto waves = [this](double omega_rad_s, double rpm) {
      return 60 * omega_rad_s / (teeth_ * rpm * kTwoPi);
    };
    const int first =
        std::max(0, static_cast<int>(std::floor(waves(stretch.front().omega_rad_s, to_rpm))) - 1);
    const int last = static_cast<int>(std::ceil(waves(stretch.back().omega_rad_s, from_rpm)));
    double lobe_before = 0;  // its slowest speed
    for (int k = first; k <= last; ++k) {
      const auto speed = [&](const Node& n) {
        const double turn = n.phase_rad + kTwoPi * k;
        return turn > 0 ? 60 * n.omega_rad_s / (teeth_ * turn) : kInfinite;
      };
      double slowest = kInfinite;
      double fastest = 0;
      for (std::size_t i = 0; i < stretch.size(); ++i) {
        double slow = speed(stretch[i]);
        double fast = slow;
        if (i > 0 && i + 1 < stretch.size()) {  // a lobe may fold back between two nodes
          const Node& a = stretch[i - 1];
          const Node& b = stretch[i + 1];
          const auto at = [&](double x) {
            const bool left = x < stretch[i].omega_rad_s;
            return speed(left ? node_between(a, stretch[i], x) : node_between(stretch[i], b, x));
          };
          if (slow < speed(a) && slow < speed(b))
            slow =
                at(highest_between([&](double x) { return -at(x); }, a.omega_rad_s, b.omega_rad_s));
          if (fast > speed(a) && fast > speed(b))
            fast = at(highest_between(at, a.omega_rad_s, b.omega_rad_s));
        }
        slowest = std::min(slowest, slow);
        fastest = std::max(fastest, fast);
      }
      parts.push_back({slowest, fastest});
      // Each lobe is the one before with a vibration more between two teeth, which brings its slow
      // end down further than its fast end: once two overlap, all slower ones do.
      if (fastest >= lobe_before && lobe_before > 0) {
        parts.push_back({0, fastest});
        break;
      }
      lobe_before = slowest;
    }
  }
  return united(std::move(parts), from_rpm, to_rpm);
}

Expected<LimitDepthBand> limit_depth_band(const Structure& structure, const MillingTool& tool,
                                          const MillingCut& cut, double ratio_low,
                                          double ratio_high,
                                          std::span<const double> spindle_speed_rpm, int ratios) {
  if (auto error = refuse_axis(spindle_speed_rpm, "spindle speed", "rpm")) return *error;
  const auto charts = charts_over(structure, tool, cut, ratio_low, ratio_high, ratios);
  if (!charts) return charts.error();
  LimitDepthBand band;
  for (const double speed : spindle_speed_rpm) {
    double lowest = kInfinite;
    double highest = 0;
    for (const StabilityLobes& chart : *charts) {
      const double depth = chart.limit_at(speed).axial_depth_m;
      lowest = std::min(lowest, depth);
      highest = std::max(highest, depth);
    }
    band.spindle_speed_rpm.push_back(speed);
    band.lowest_depth_m.push_back(lowest);
    band.highest_depth_m.push_back(highest);
  }
  return band;
}

Expected<std::vector<SpeedInterval>> safe_speeds(const Structure& structure,
                                                 const MillingTool& tool, const MillingCut& cut,
                                                 double ratio_low, double ratio_high,
                                                 double axial_depth_m, double from_rpm,
                                                 double to_rpm, int ratios) {
  if (!(from_rpm > 0 && from_rpm < to_rpm) || !std::isfinite(to_rpm))
    return usage_error("The range of spindle speeds must rise from a positive speed.");
  if (auto error = refuse_axis({&axial_depth_m, 1}, "axial depth", "m")) return *error;
  const auto charts = charts_over(structure, tool, cut, ratio_low, ratio_high, ratios);
  if (!charts) return charts.error();
  std::vector<SpeedInterval> parts;
  for (const StabilityLobes& chart : *charts) {
    const auto unstable = chart.unstable_speeds(axial_depth_m, from_rpm, to_rpm);
    parts.insert(parts.end(), unstable.begin(), unstable.end());
  }
  std::vector<SpeedInterval> safe;
  double free_from = from_rpm;
  const std::vector<SpeedInterval> covered = united(std::move(parts), from_rpm, to_rpm);
  for (const SpeedInterval& part : covered) {
    if (part.from_rpm > free_from) safe.push_back({free_from, part.from_rpm});
    free_from = std::max(free_from, part.to_rpm);
  }
  if (free_from < to_rpm) safe.push_back({free_from, to_rpm});
  return safe;
}

}  // namespace servosense
