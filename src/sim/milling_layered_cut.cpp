#include <algorithm>
#include <cmath>
#include <cstring>
#include <type_traits>

#include "servosense/sim/layered_cut.hpp"

namespace servosense {
namespace {

// Two doubles, the vector every 64-bit machine has, and always two of them at a time: sums are
// formed in the same order, and come out the same, everywhere.
using Pair = double __attribute__((vector_size(16)));
using Mask = long long __attribute__((vector_size(16)));
constexpr std::size_t kPack = 4;

inline void load(const double* from, Pair& to) { std::memcpy(&to, from, sizeof to); }
inline void store(const Pair& from, double* to) { std::memcpy(to, &from, sizeof from); }
inline double total(const Pair& a, const Pair& b) { return (a[0] + a[1]) + (b[0] + b[1]); }
inline std::size_t whole(std::size_t layers) { return (layers + kPack - 1) / kPack * kPack; }

}  // namespace

// Over the layers of a tooth: tangential and radial force, plain and rotated by the lag.
struct LayeredCut::Sums {
  double tangential = 0, tangential_cos = 0, tangential_sin = 0;
  double radial_cos = 0, radial_sin = 0;
  bool cutting = false;
};

LayeredCut::LayeredCut(const Config& config, double angle_rad, double axis_x_m)
    : law_(config.tool.force),
      radius_m_(config.tool.radius_m()),
      feed_per_rad_m_(config.feed_per_tooth_m * config.tool.teeth / kTwoPi),
      trochoidal_(config.trochoidal),
      linear_(law_.size_effect_exponent == 0 && law_.process_damping_N_s_per_m2 == 0),
      edges_(law_.tangential_edge_N_per_m != 0 || law_.radial_edge_N_per_m != 0),
      wedge_(config.wedge),
      straight_(config.tool.helix_deg == 0),
      front_depth_m_(config.front_depth_m),
      depth_slope_(config.depth_slope),
      rows_(static_cast<std::size_t>(config.rows)),
      row_rad_(kTwoPi / config.rows),
      rows_per_rad_(config.rows / kTwoPi),
      window_(config.window) {
  const MillingTool& tool = config.tool;
  const auto teeth = static_cast<std::size_t>(tool.teeth);

  // A straight tooth is one layer, unless the depth changes on the way: more would only repeat it.
  std::vector<double> ends;
  const int layers = straight_ && !wedge_ ? 1 : config.layers;
  for (int i = 0; i <= layers; ++i) ends.push_back(config.depth_m * i / layers);
  for (const auto* fractions : {&tool.broken_fraction, &config.break_fractions})
    for (const double fraction : *fractions) ends.push_back(config.depth_m * fraction);
  std::sort(ends.begin(), ends.end());
  const double nearly_the_same = 1e-9 * config.depth_m;
  ends.erase(std::unique(ends.begin(), ends.end(),
                         [&](double a, double b) { return b - a < nearly_the_same; }),
             ends.end());

  layers_ = ends.size() - 1;
  stride_ = whole(layers_);
  const double lag_per_m = std::tan(rad_from_deg(tool.helix_deg)) / radius_m_;
  total_lag_ = lag_per_m * config.depth_m;
  layers_per_rad_ = straight_ ? 0 : layers / total_lag_;
  for (std::vector<double>* v : {&bottom_m_, &width_m_, &lag_from_, &lag_to_, &cos_lag_, &sin_lag_})
    v->assign(stride_, 0.0);
  for (std::size_t l = 0; l < layers_; ++l) {
    bottom_m_[l] = ends[l];
    width_m_[l] = ends[l + 1] - ends[l];
    lag_from_[l] = lag_per_m * ends[l];
    lag_to_[l] = lag_per_m * ends[l + 1];
    cos_lag_[l] = std::cos((lag_from_[l] + lag_to_[l]) / 2);
    sin_lag_[l] = std::sin((lag_from_[l] + lag_to_[l]) / 2);
  }
  part_width_m_.assign(stride_, 0.0);

  for (std::size_t q = 0; q <= rows_; ++q) {
    row_sin_.push_back(std::sin(static_cast<double>(q) * row_rad_));
    row_cos_.push_back(std::cos(static_cast<double>(q) * row_rad_));
  }

  const auto n = static_cast<double>(rows_);
  throw_m_ = tool.throw_m.empty() ? std::vector<double>(teeth, 0.0) : tool.throw_m;
  intact_from_.assign(teeth, 0);
  for (std::size_t i = 0; i < teeth; ++i) {
    const double ahead = tool.tooth_angle_rad.empty()
                             ? n * static_cast<double>(i) / static_cast<double>(teeth)
                             : tool.tooth_angle_rad[i] * rows_per_rad_;
    const double at = angle_rad * rows_per_rad_ + ahead;
    tooth_rows_.push_back(at - n * std::floor(at / n));
    if (tooth_rows_[i] >= n) tooth_rows_[i] = 0;
    if (!tool.broken_fraction.empty()) break_tooth(i, tool.broken_fraction[i]);
  }

  // What a tooth reads in the cut it must have passed before: the layer or the step that is partly
  // in, and a row in hand.
  margin_ = 2 * row_rad_ + (straight_ ? kPi / (16 * tool.teeth) : total_lag_ / layers);
  window_low_ = window_.start_rad - margin_;
  window_high_ = window_.exit_rad + margin_ + total_lag_;

  // The last revolution before the start, of a tool that does not vibrate. `back_rows` is how far
  // the tooth has turned since it was on the row.
  surface_m_.assign(rows_ * stride_, 0.0);
  if (trochoidal_) surface_feed_m_.assign(rows_ * stride_, 0.0);
  before_m_.assign(teeth * stride_, 0.0);
  before_feed_m_.assign(trochoidal_ ? teeth * stride_ : 0, 0.0);
  const double feed_per_row = feed_per_rad_m_ * row_rad_;
  constexpr auto nobody = static_cast<std::size_t>(-1);
  const auto fill = [&](std::size_t q, std::size_t not_yet, double* reach, double* feed) {
    for (std::size_t l = 0; l < layers_; ++l) {
      const double sine = row_sin_[q] * cos_lag_[l] - row_cos_[q] * sin_lag_[l];
      const double cosine = row_cos_[q] * cos_lag_[l] + row_sin_[q] * sin_lag_[l];
      bool first = true;
      double thinnest = 0;
      for (std::size_t i = 0; i < teeth; ++i) {
        if (l < intact_from_[i]) continue;
        double back_rows = tooth_rows_[i] - static_cast<double>(q);
        back_rows -= n * std::floor(back_rows / n);
        if (i == not_yet) back_rows += n;
        const double since = feed_per_row * back_rows;
        const double chip =
            since * sine - throw_m_[i] + (trochoidal_ ? trochoid_term(since, sine, cosine) : 0.0);
        if (!first && chip >= thinnest) continue;
        first = false;
        thinnest = chip;
        reach[l] = (axis_x_m - since) * sine + throw_m_[i];
        if (feed != nullptr) feed[l] = axis_x_m - since;
      }
    }
  };
  for (std::size_t q = 0; q < rows_; ++q)
    fill(q, nobody, row(surface_m_, q), trochoidal_ ? row(surface_feed_m_, q) : nullptr);
  for (std::size_t i = 0; i < teeth; ++i) {
    const auto q = static_cast<std::size_t>(tooth_rows_[i]);
    fill(q, i, row(before_m_, i), trochoidal_ ? row(before_feed_m_, i) : nullptr);
  }
  last_axis_.x_m = axis_x_m;
}

void LayeredCut::break_tooth(std::size_t tooth, double fraction) {
  const double height =
      (bottom_m_[layers_ - 1] + width_m_[layers_ - 1]) * fraction - 1e-6 * width_m_[0];
  std::size_t first = 0;
  while (first < layers_ && bottom_m_[first] < height) ++first;
  intact_from_[tooth] = std::max(intact_from_[tooth], first);
}

// First layer that ends above a lag: nearly always where uniform layers would have it.
std::size_t LayeredCut::layer_above(double lag_rad) const {
  if (lag_rad < 0) return 0;
  if (lag_rad >= total_lag_) return layers_;
  auto l = std::min(static_cast<std::size_t>(lag_rad * layers_per_rad_), layers_ - 1);
  while (l > 0 && lag_to_[l - 1] > lag_rad) --l;
  while (l < layers_ && lag_to_[l] <= lag_rad) ++l;
  return l;
}

LayeredCut::Range LayeredCut::layers_between(double low_lag_rad, double high_lag_rad) const {
  if (straight_) return {0, low_lag_rad <= 0 && high_lag_rad >= 0 ? layers_ : 0};
  if (high_lag_rad < 0) return {};
  return {layer_above(low_lag_rad), std::min(layer_above(high_lag_rad) + 1, layers_)};
}

LayeredCut::Load LayeredCut::advance(double turn_rad, double blur_rad, const Axis& axis,
                                     double cutting_speed_m_s, std::span<const Engagement> arcs) {
  Load load;
  const auto n = static_cast<double>(rows_);
  const double turn_rows = turn_rad * rows_per_rad_;
  for (std::size_t i = 0; i < throw_m_.size(); ++i) {
    const double from = tooth_rows_[i];
    const double to = from + turn_rows;
    tooth_rows_[i] = to < n ? to : to - n;  // exact, so that no row is passed twice or never

    // Rows passed on the way: each is left where the axis was at that moment.
    for (auto q = static_cast<std::size_t>(from) + 1; static_cast<double>(q) <= to; ++q) {
      const std::size_t index = q % rows_;
      const double phi = static_cast<double>(index) * row_rad_;
      for (double tip = phi - kTwoPi; tip <= window_high_; tip += kTwoPi) {
        if (tip < window_low_) continue;
        Range range =
            layers_between(tip - window_.exit_rad - margin_, tip - window_.start_rad + margin_);
        range.first = std::max(range.first, intact_from_[i]);
        if (range.first >= range.last) continue;  // nothing here to leave a surface
        const double g = (static_cast<double>(q) - from) / turn_rows;
        leave_surface(i, index,
                      {last_axis_.x_m + g * (axis.x_m - last_axis_.x_m),
                       last_axis_.y_m + g * (axis.y_m - last_axis_.y_m), 0, 0},
                      range);
      }
    }

    const auto passed = static_cast<std::size_t>(to);
    const std::size_t index = passed % rows_;
    const double share = to - static_cast<double>(passed);
    const double phi = (static_cast<double>(index) + share) * row_rad_;
    if ((phi >= window_low_ && phi <= window_high_) || phi - kTwoPi >= window_low_ ||
        phi + kTwoPi <= window_high_)
      add_load(i, index, share, phi, axis, blur_rad, cutting_speed_m_s, arcs, load);
  }
  last_axis_ = axis;
  return load;
}

void LayeredCut::leave_surface(std::size_t tooth, std::size_t index, const Axis& axis,
                               const Range& range) {
  const double s = row_sin_[index], c = row_cos_[index];
  const double a = axis.x_m * s + axis.y_m * c;
  const double b = axis.y_m * s - axis.x_m * c;
  const double reach = throw_m_[tooth];
  double* const surface = row(surface_m_, index);
  double* const before = row(before_m_, tooth);
  if (!trochoidal_) {
    const Pair reach2 = {reach, reach}, a2 = {a, a}, b2 = {b, b};
    std::size_t l = range.first;
    if (l % 2 == 1) {
      before[l] = surface[l];
      surface[l] = std::max(surface[l], reach + a * cos_lag_[l] + b * sin_lag_[l]);
      ++l;
    }
    for (; l < range.last; l += 2) {
      Pair w, cl, sl;
      load(surface + l, w);
      load(cos_lag_.data() + l, cl);
      load(sin_lag_.data() + l, sl);
      store(w, before + l);
      const Pair chip = reach2 + a2 * cl + b2 * sl - w;
      store(w + (Pair)((chip > 0) & (Mask)chip), surface + l);
    }
    return;
  }
  double* const feed = row(surface_feed_m_, index);
  double* const before_feed = row(before_feed_m_, tooth);
  for (std::size_t l = range.first; l < range.last; ++l) {
    before[l] = surface[l];
    before_feed[l] = feed[l];
    const double now = reach + a * cos_lag_[l] + b * sin_lag_[l];
    const double sine = s * cos_lag_[l] - c * sin_lag_[l];
    const double cosine = c * cos_lag_[l] + s * sin_lag_[l];
    const double chip = now - surface[l] + trochoid_term(axis.x_m - feed[l], sine, cosine);
    // Behind the axis the feed leaves the surface: the last tooth is the one that counts.
    if (chip > 0 || sine < 0) {
      surface[l] = now;
      feed[l] = axis.x_m;
    }
  }
}

void LayeredCut::add_load(std::size_t tooth, std::size_t index, double share, double phi,
                          const Axis& axis, double blur_rad, double cutting_speed_m_s,
                          std::span<const Engagement> arcs, Load& load) {
  // The chord between the two rows, see the header.
  const double sine = row_sin_[index] + share * (row_sin_[index + 1] - row_sin_[index]);
  const double cosine = row_cos_[index] + share * (row_cos_[index + 1] - row_cos_[index]);
  const std::size_t next = index + 1 == rows_ ? 0 : index + 1;
  const double* const before = row(before_m_, tooth);
  const double* const ahead = row(surface_m_, next);
  bool cutting = false;

  for (double tip = phi - kTwoPi; tip <= window_high_; tip += kTwoPi) {
    if (tip < window_low_) continue;
    for (const Engagement& arc : arcs) {
      const double low = tip - arc.exit_rad, high = tip - arc.start_rad;
      // A straight tooth enters and leaves within one step: count the part of the step it is in.
      const double blur = straight_ ? blur_rad / 2 : 0;
      Range range = layers_between(low - blur, high + blur);
      range.first = std::max(range.first, intact_from_[tooth]);
      if (range.first >= range.last) continue;

      const auto part_in = [&](double from, double to) {
        return std::clamp((std::min(to, high) - std::max(from, low)) / (to - from), 0.0, 1.0);
      };
      double straight_part = 1;
      if (straight_ && blur > 0) straight_part = part_in(-blur, blur);
      // Width of each layer in the cut. The packs at the ends of the range are edited for this
      // evaluation: no width beyond the range, part of it where a layer is partly in the arc.
      double* width = width_m_.data();
      if (wedge_) {
        width = part_width_m_.data();
        const double here = front_depth_m_ + depth_slope_ * axis.x_m;
        const double along = depth_slope_ * radius_m_;
        for (std::size_t l = range.first; l < range.last; ++l) {
          const double tip_sine = sine * cos_lag_[l] - cosine * sin_lag_[l];
          width[l] = std::clamp(here + along * tip_sine - bottom_m_[l], 0.0, width_m_[l]);
        }
      }
      const Range packs{range.first / kPack * kPack, whole(range.last)};
      double low_pack[kPack], high_pack[kPack];
      std::memcpy(low_pack, width + packs.first, sizeof low_pack);
      std::memcpy(high_pack, width + packs.last - kPack, sizeof high_pack);
      for (std::size_t l = packs.first; l < range.first; ++l) width[l] = 0;
      for (std::size_t l = range.last; l < packs.last; ++l) width[l] = 0;
      if (!straight_) {  // the first and the last layer may be partly in the arc
        const std::size_t last = range.last - 1;
        const auto partly_in = [&](std::size_t l) {
          return lag_from_[l] < low || lag_to_[l] > high;  // spares the division
        };
        if (partly_in(range.first))
          width[range.first] *= part_in(lag_from_[range.first], lag_to_[range.first]);
        if (last != range.first && partly_in(last))
          width[last] *= part_in(lag_from_[last], lag_to_[last]);
      }
      Sums sums;
      if (trochoidal_) {
        sums = cut_general<true>(range, width, tooth, index, share, throw_m_[tooth], sine, cosine,
                                 axis, cutting_speed_m_s);
      } else if (!linear_) {
        sums = cut_general<false>(range, width, tooth, index, share, throw_m_[tooth], sine, cosine,
                                  axis, cutting_speed_m_s);
      } else {
        sums = cut_linear(packs, width, before, ahead, share, throw_m_[tooth],
                          axis.x_m * sine + axis.y_m * cosine, axis.y_m * sine - axis.x_m * cosine);
      }
      std::memcpy(width + packs.last - kPack, high_pack, sizeof high_pack);
      std::memcpy(width + packs.first, low_pack, sizeof low_pack);
      // Force on the tool: -Ft (cos, -sin) - Fr (sin, cos) of theta = phi - lag.
      const double tangential_cos = cosine * sums.tangential_cos + sine * sums.tangential_sin;
      const double tangential_sin = sine * sums.tangential_cos - cosine * sums.tangential_sin;
      const double radial_cos = cosine * sums.radial_cos + sine * sums.radial_sin;
      const double radial_sin = sine * sums.radial_cos - cosine * sums.radial_sin;
      load.fx_N -= straight_part * (tangential_cos + radial_sin);
      load.fy_N += straight_part * (tangential_sin - radial_cos);
      load.torque_Nm += straight_part * sums.tangential * radius_m_;
      cutting = cutting || sums.cutting;
    }
  }
  load.teeth_in_cut += cutting;
}

// Force proportional to chip thickness, plus edge forces where there is a chip.
LayeredCut::Sums LayeredCut::cut_linear(const Range& range, const double* width,
                                        const double* before, const double* ahead, double share,
                                        double reach, double a, double b) const {
  const double* const cos_lag = cos_lag_.data();
  const double* const sin_lag = sin_lag_.data();
  const Pair reach2 = {reach, reach}, a2 = {a, a}, b2 = {b, b}, share2 = {share, share};
  struct Totals {
    Pair area{}, area_cos{}, area_sin{}, edge{}, edge_cos{}, edge_sin{};
  } even, odd;
  const auto sum_up = [&](auto with_edges) {
    const auto take = [&](std::size_t l, Totals& t) {
      Pair wb, wa, cl, sl, dz;
      load(before + l, wb);
      load(ahead + l, wa);
      load(cos_lag + l, cl);
      load(sin_lag + l, sl);
      load(width + l, dz);
      const Pair gap = reach2 + a2 * cl + b2 * sl - (wb + share2 * (wa - wb));
      const Mask in_cut = gap > 0;
      const Pair chip = (Pair)(in_cut & (Mask)gap) * dz;
      t.area += chip;
      t.area_cos += chip * cl;
      t.area_sin += chip * sl;
      if constexpr (with_edges) {
        const Pair length = (Pair)(in_cut & (Mask)dz);
        t.edge += length;
        t.edge_cos += length * cl;
        t.edge_sin += length * sl;
      }
    };
    for (std::size_t l = range.first; l < range.last; l += kPack) {
      take(l, even);
      take(l + 2, odd);
    }
  };
  if (edges_) {
    sum_up(std::true_type{});
  } else {
    sum_up(std::false_type{});
  }

  const double kt = law_.tangential_coefficient_N_per_m2;
  const double kr = law_.radial_ratio * kt;
  const double kte = law_.tangential_edge_N_per_m, kre = law_.radial_edge_N_per_m;
  const double h = total(even.area, odd.area), h_cos = total(even.area_cos, odd.area_cos),
               h_sin = total(even.area_sin, odd.area_sin);
  const double e = total(even.edge, odd.edge), e_cos = total(even.edge_cos, odd.edge_cos),
               e_sin = total(even.edge_sin, odd.edge_sin);
  Sums sums;
  sums.tangential = kt * h + kte * e;
  sums.tangential_cos = kt * h_cos + kte * e_cos;
  sums.tangential_sin = kt * h_sin + kte * e_sin;
  sums.radial_cos = kr * h_cos + kre * e_cos;
  sums.radial_sin = kr * h_sin + kre * e_sin;
  sums.cutting = h > 0;
  return sums;
}

// Every effect, layer by layer: trochoidal path, size effect, process damping.
template <bool Trochoidal>
LayeredCut::Sums LayeredCut::cut_general(const Range& range, const double* width, std::size_t tooth,
                                         std::size_t index, double share, double reach, double sine,
                                         double cosine, const Axis& axis,
                                         double cutting_speed_m_s) {
  const std::size_t next = index + 1 == rows_ ? 0 : index + 1;
  const double* const before = row(before_m_, tooth);
  const double* const ahead = row(surface_m_, next);
  const double* const before_feed = Trochoidal ? row(before_feed_m_, tooth) : nullptr;
  const double* const ahead_feed = Trochoidal ? row(surface_feed_m_, next) : nullptr;
  const double kt = law_.tangential_coefficient_N_per_m2;
  const double damping =
      cutting_speed_m_s > 0 ? law_.process_damping_N_s_per_m2 / cutting_speed_m_s : 0;
  Sums sums;
  for (std::size_t l = range.first; l < range.last; ++l) {
    const double cl = cos_lag_[l], sl = sin_lag_[l];
    const double sin_theta = sine * cl - cosine * sl;
    const double cos_theta = cosine * cl + sine * sl;
    double h = reach + axis.x_m * sin_theta + axis.y_m * cos_theta -
               (before[l] + share * (ahead[l] - before[l]));
    if constexpr (Trochoidal)
      h += trochoid_term(axis.x_m - (before_feed[l] + share * (ahead_feed[l] - before_feed[l])),
                         sin_theta, cos_theta);
    if (!(h > 0) || width[l] == 0) continue;
    double chip_force = kt * h;
    if (law_.size_effect_exponent != 0)
      chip_force *= std::pow(h / law_.size_effect_reference_m, -law_.size_effect_exponent);
    const double into_work = axis.vx_m_s * sin_theta + axis.vy_m_s * cos_theta;
    const double tangential = (chip_force + law_.tangential_edge_N_per_m) * width[l];
    const double radial =
        (law_.radial_ratio * chip_force + law_.radial_edge_N_per_m + damping * into_work) *
        width[l];
    sums.tangential += tangential;
    sums.tangential_cos += tangential * cl;
    sums.tangential_sin += tangential * sl;
    sums.radial_cos += radial * cl;
    sums.radial_sin += radial * sl;
    sums.cutting = true;
  }
  return sums;
}

}  // namespace servosense
