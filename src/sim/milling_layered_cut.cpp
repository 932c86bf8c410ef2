#include <algorithm>
#include <array>
#include <cmath>
#include <type_traits>
#include <utility>

#include "milling_pair.hpp"
#include "servosense/sim/layered_cut.hpp"

namespace servosense {
namespace {

constexpr double kWall = 1e-9;  // sine of the tooth angle

double total(const Pair& pair) { return pair[0] + pair[1]; }

// Sum of a quantity over edges in the cut, and its moments with their angle; in two lanes.
struct Moments {
  Pair plain{}, cosine{}, sine{};

  void add(const Pair& value, const Pair& cos_angle, const Pair& sin_angle) {
    plain += value;
    cosine += value * cos_angle;
    sine += value * sin_angle;
  }
  /// Adds moments with the lag of the layers, seen from a tip: theta = phi - lag.
  void add(const Moments& from, double cos_phi, double sin_phi) {
    const Pair c = both(cos_phi), s = both(sin_phi);
    plain += from.plain;
    cosine += c * from.cosine + s * from.sine;
    sine += s * from.cosine - c * from.sine;
  }
  Moments& operator*=(double factor) {
    plain *= both(factor);
    cosine *= both(factor);
    sine *= both(factor);
    return *this;
  }
};

// What the tip's trochoid adds to a chip, `since` the feed since the surface there was left.
inline Pair trochoid_term(const Pair& since, const Pair& sine, const Pair& cosine,
                          double feed_per_rad_m, double radius_m) {
  // After a revolution without a chip the place that was cut then has been left behind.
  const Pair feed = lower(since, both(kTwoPi * feed_per_rad_m));
  return feed * cosine * both(1 / radius_m) *
         (both(0.5) * feed * cosine - both(feed_per_rad_m) * sine);
}

}  // namespace

struct LayeredCut::Sums {
  Moments chip;  // effective chip area: h dz, with its size effect
  Moments edge;  // length of edge in the cut
  Moments drag;  // process damping, radial force
};

struct LayeredCut::Place {
  double sine = 0, cosine = 0;  // of the tip, on the chord between two rows
  double share = 0, throw_m = 0;
  std::size_t row = 0, next = 0;
  double low_m = 0, high_m = 0;     // heights in the cut
  std::size_t first = 0, last = 0;  // layers at their ends
  double part = 1;                  // of the step that a straight tooth is in the cut
};

LayeredCut::LayeredCut(const Config& config, double angle_rad, double axis_x_m)
    : law_(config.tool.force),
      radius_m_(config.tool.radius_m()),
      feed_per_rad_m_(config.feed_per_tooth_m * config.tool.teeth / kTwoPi),
      trochoidal_(config.trochoidal),
      straight_(config.tool.helix_deg == 0),
      front_depth_m_(config.front_depth_m),
      depth_slope_(config.depth_slope),
      rows_(static_cast<std::size_t>(config.rows)),
      row_rad_(kTwoPi / config.rows),
      rows_per_rad_(config.rows / kTwoPi) {
  const bool edges = law_.tangential_edge_N_per_m != 0 || law_.radial_edge_N_per_m != 0;
  if (edges || law_.axial_edge_N_per_m != 0) effects_ |= kEdges;
  if (config.wedge) effects_ |= kWedge;
  if (law_.size_effect_exponent != 0 || law_.process_damping_N_per_m != 0) effects_ |= kOthers;
  if (trochoidal_) effects_ |= kTrochoid;
  const MillingTool& tool = config.tool;
  const auto teeth = static_cast<std::size_t>(tool.teeth);

  // A straight tooth is one layer, unless the depth changes on the way: more would only repeat it.
  std::vector<double> ends;
  const int layers = straight_ && !config.wedge ? 1 : config.layers;
  for (int i = 0; i <= layers; ++i) ends.push_back(config.depth_m * i / layers);
  for (const auto* fractions : {&tool.broken_fraction, &config.break_fractions})
    for (const double fraction : *fractions) ends.push_back(config.depth_m * fraction);
  std::sort(ends.begin(), ends.end());
  const double nearly_the_same = 1e-9 * config.depth_m;
  ends.erase(std::unique(ends.begin(), ends.end(),
                         [&](double a, double b) { return b - a < nearly_the_same; }),
             ends.end());

  layers_ = ends.size() - 1;
  stride_ = layers_ + layers_ % 2;
  depth_m_ = ends[layers_];
  layers_per_m_ = layers / config.depth_m;
  const double lag_per_m = std::tan(rad_from_deg(tool.helix_deg)) / radius_m_;
  const double total_lag = lag_per_m * depth_m_;
  height_per_rad_ = straight_ ? 0 : 1 / lag_per_m;
  layer_.resize(stride_ / 2);
  for (std::size_t l = 0; l < layers_; ++l) {
    LayerPair& pair = layer_[l / 2];
    pair.bottom_m[l % 2] = ends[l];
    pair.width_m[l % 2] = ends[l + 1] - ends[l];
    pair.cosine[l % 2] = std::cos(lag_per_m * (ends[l] + ends[l + 1]) / 2);
    pair.sine[l % 2] = std::sin(lag_per_m * (ends[l] + ends[l + 1]) / 2);
    top_m_.push_back(ends[l + 1]);
  }

  for (std::size_t q = 0; q <= rows_; ++q) {
    row_sin_.push_back(std::sin(static_cast<double>(q) * row_rad_));
    row_cos_.push_back(std::cos(static_cast<double>(q) * row_rad_));
  }

  const auto n = static_cast<double>(rows_);
  teeth_.resize(teeth);
  for (std::size_t i = 0; i < teeth; ++i) {
    Tooth& tooth = teeth_[i];
    const double ahead = tool.tooth_angle_rad.empty()
                             ? n * static_cast<double>(i) / static_cast<double>(teeth)
                             : tool.tooth_angle_rad[i] * rows_per_rad_;
    double at = angle_rad * rows_per_rad_ + ahead;
    at -= n * std::floor(at / n);
    if (at >= n) at = 0;
    tooth.row = static_cast<std::size_t>(at);
    tooth.share = at - static_cast<double>(tooth.row);
    if (!tool.throw_m.empty()) tooth.throw_m = tool.throw_m[i];
    farthest_throw_m_ = i == 0 ? tooth.throw_m : std::max(farthest_throw_m_, tooth.throw_m);
    if (!tool.broken_fraction.empty()) break_tooth(i, tool.broken_fraction[i]);
  }

  // Which layers of a row are in the window never changes. What a tooth reads in the cut it must
  // have passed before: the layer or the step that is partly in, and a row in hand.
  const double margin = 2 * row_rad_ + (straight_ ? kPi / (16 * tool.teeth) : total_lag / layers);
  const double low = config.window.start_rad - margin, high = config.window.exit_rad + margin;
  for (std::size_t q = 0; q < rows_; ++q) {
    first_pass_.push_back(static_cast<std::uint32_t>(passes_.size()));
    for (double turn = -kTwoPi; turn <= high + total_lag; turn += kTwoPi) {
      const double tip = static_cast<double>(q) * row_rad_ + turn;
      if (tip < low || tip > high + total_lag) continue;
      Pass pass{turn, 0, static_cast<std::uint32_t>(layers_)};
      if (!straight_) {
        const auto layer = [&](double lag_rad) {
          const double height_m = std::clamp(lag_rad * height_per_rad_, 0.0, depth_m_);
          return static_cast<std::uint32_t>(layer_at(height_m));
        };
        pass.first = layer(tip - high);
        pass.last = layer(tip - low) + 1;
      }
      passes_.push_back(pass);
    }
  }
  first_pass_.push_back(static_cast<std::uint32_t>(passes_.size()));

  // The last revolution before the start, of a tool that does not vibrate. `back_rows` is how far
  // the tooth has turned since it was on the row; on the row passed last it has left nothing yet.
  surface_m_.assign(rows_ * stride_, 0.0);
  if (trochoidal_) surface_feed_m_.assign(rows_ * stride_, 0.0);
  const double feed_per_row = feed_per_rad_m_ * row_rad_;
  for (std::size_t q = 0; q < rows_; ++q) {
    for (std::size_t l = 0; l < layers_; ++l) {
      const double sine = row_sin_[q] * cos_lag(l) - row_cos_[q] * sin_lag(l);
      const double cosine = row_cos_[q] * cos_lag(l) + row_sin_[q] * sin_lag(l);
      bool first = true;
      double thinnest = 0;
      for (const Tooth& tooth : teeth_) {
        if (l < tooth.intact_from) continue;
        double back_rows = static_cast<double>(tooth.row) - static_cast<double>(q) + tooth.share;
        if (tooth.row <= q) back_rows += n;
        const double since = feed_per_row * back_rows;
        const double chip = since * sine - tooth.throw_m +
                            (trochoidal_ ? trochoid_term(both(since), both(sine), both(cosine),
                                                         feed_per_rad_m_, radius_m_)[0]
                                         : 0.0);
        if (!first && chip >= thinnest) continue;
        first = false;
        thinnest = chip;
        surface_m_[q * stride_ + l] = (axis_x_m - since) * sine + tooth.throw_m;
        if (trochoidal_) surface_feed_m_[q * stride_ + l] = axis_x_m - since;
      }
    }
  }
  for (Tooth& tooth : teeth_) tooth.passed_x_m = axis_x_m - feed_per_row * tooth.share;
  last_axis_.x_m = axis_x_m;
}

void LayeredCut::break_tooth(std::size_t tooth, double fraction) {
  const double height = depth_m_ * fraction - 1e-6 * width_m(0);
  std::size_t first = 0;
  while (first < layers_ && bottom_m(first) < height) ++first;
  Tooth& broken = teeth_[tooth];
  if (first <= broken.intact_from) return;
  if (!surface_m_.empty()) leave_surface(broken, broken.intact_from, first);  // the last it does
  broken.intact_from = first;
  broken.intact_from_m = broken.intact_from < layers_ ? bottom_m(broken.intact_from) : depth_m_;
}

// The layer at a height from 0 to the depth: nearly always where uniform layers would have it, and
// above when broken teeth have divided some of them.
std::size_t LayeredCut::layer_at(double height_m) const {
  auto l = std::min(static_cast<std::size_t>(height_m * layers_per_m_), layers_ - 1);
  while (top_m_[l] < height_m) ++l;
  return l;
}

LayeredCut::Load LayeredCut::advance(double turn_rad, double blur_rad, const Axis& axis,
                                     double cutting_speed_m_s, std::span<const Engagement> arcs) {
  const double turn_rows = turn_rad * rows_per_rad_;
  const Axis leaves{axis.x_m - axis.forgotten_x_m, axis.y_m - axis.forgotten_y_m};
  for (Tooth& tooth : teeth_) {
    const double to = tooth.share + turn_rows;
    const auto passed = static_cast<std::int64_t>(to);
    if (passed > 0) pass_rows(tooth, passed, turn_rows, leaves);
    tooth.share = to - static_cast<double>(passed);
  }
  last_axis_ = leaves;

  // A function for each combination of effects, so that none pays for what it does not have.
  static constexpr auto kLoads = loads(std::make_index_sequence<kCombinations>());
  return (this->*kLoads[effects_])({axis, blur_rad, cutting_speed_m_s, arcs});
}

template <std::size_t kEffects>
LayeredCut::Load LayeredCut::load(const Moment& now) const {
  Sums sums;
  int teeth = 0;
  for (const Tooth& tooth : teeth_)
    if (meets_work(tooth.row)) teeth += add_tooth<kEffects>(tooth, now, sums);

  // Force on the tool: -Ft (cos, -sin) - Fr (sin, cos) of theta.
  Load load;
  const double kt = law_.tangential_coefficient_N_per_m2, kr = law_.radial_ratio * kt;
  const double chip_cos = total(sums.chip.cosine), chip_sin = total(sums.chip.sine);
  load.fx_N = -(kt * chip_cos + kr * chip_sin);
  load.fy_N = kt * chip_sin - kr * chip_cos;
  load.fz_N = law_.axial_coefficient_N_per_m2 * total(sums.chip.plain);
  load.torque_Nm = kt * total(sums.chip.plain) * radius_m_;
  load.teeth_in_cut = teeth;
  if constexpr ((kEffects & kEdges) != 0) {
    const double kte = law_.tangential_edge_N_per_m, kre = law_.radial_edge_N_per_m;
    const double edge_cos = total(sums.edge.cosine), edge_sin = total(sums.edge.sine);
    load.fx_N -= kte * edge_cos + kre * edge_sin;
    load.fy_N += kte * edge_sin - kre * edge_cos;
    load.fz_N += law_.axial_edge_N_per_m * total(sums.edge.plain);
    load.torque_Nm += kte * total(sums.edge.plain) * radius_m_;
  }
  if constexpr ((kEffects & kOthers) != 0) {
    load.fx_N -= total(sums.drag.sine);
    load.fy_N -= total(sums.drag.cosine);
  }
  return load;
}

void LayeredCut::pass_rows(Tooth& tooth, std::int64_t passed, double turn_rows, const Axis& axis) {
  for (std::int64_t k = 1; k <= passed; ++k) {
    if (meets_work(tooth.row)) leave_surface(tooth, tooth.intact_from, layers_);
    if (++tooth.row == rows_) tooth.row = 0;
    const double g = (static_cast<double>(k) - tooth.share) / turn_rows;
    tooth.passed_x_m = last_axis_.x_m + g * (axis.x_m - last_axis_.x_m);
    tooth.passed_y_m = last_axis_.y_m + g * (axis.y_m - last_axis_.y_m);
  }
}

// At the wall (sine 0) and behind it no feed brings fresh material: the farthest reach would stay
// for ever, and the rows beside it would not see the vibration of the last tooth. So the tooth that
// makes the wall, the one of the largest throw, leaves it anew each time. Within a pass the sine is
// least at an end.
bool LayeredCut::makes_wall(const Tooth& tooth, std::size_t low, std::size_t high) const {
  if (tooth.throw_m < farthest_throw_m_) return false;
  const double s = row_sin_[tooth.row], c = row_cos_[tooth.row];
  return s * cos_lag(low) - c * sin_lag(low) <= kWall ||
         s * cos_lag(high) - c * sin_lag(high) <= kWall;
}

// What a tooth has left on the row it passed last, from layer `begin` to below `end`.
void LayeredCut::leave_surface(const Tooth& tooth, std::size_t begin, std::size_t end) {
  const double s = row_sin_[tooth.row], c = row_cos_[tooth.row];
  const double x = tooth.passed_x_m, y = tooth.passed_y_m;
  const Pair reach = both(tooth.throw_m), a = both(x * s + y * c), b = both(y * s - x * c);
  double* const surface = surface_m_.data() + tooth.row * stride_;
  double* const feed = surface_feed_m_.data() + (trochoidal_ ? tooth.row * stride_ : 0);
  for (std::uint32_t p = first_pass_[tooth.row]; p < first_pass_[tooth.row + 1]; ++p) {
    const std::size_t first = std::max<std::size_t>(passes_[p].first, begin);
    const std::size_t last = std::min<std::size_t>(passes_[p].last, end);
    if (first >= last) continue;
    // In pairs. A layer beyond either end of the pass is out of the work, where it does no harm to
    // sweep it; but below `begin` and from `end` on a layer is put back as it was.
    const std::size_t low = first / 2 * 2, high = (last - 1) / 2 * 2 + 1;
    const bool low_back = low < begin, high_back = high >= end;
    const LayerPair* layer = layer_.data() + low / 2;
    const double low_m = surface[low], high_m = surface[high];
    if (!trochoidal_ && !makes_wall(tooth, low, high)) {
      for (std::size_t l = low; l < last; l += 2, ++layer) {
        const Pair tip = reach + a * pair_at(layer->cosine) + b * pair_at(layer->sine);
        pair_at(surface + l) = higher(tip, pair_at(surface + l));
      }
    } else if (!trochoidal_) {
      for (std::size_t l = low; l < last; l += 2, ++layer) {
        const Pair cos_lag = pair_at(layer->cosine), sin_lag = pair_at(layer->sine);
        const Pair tip = reach + a * cos_lag + b * sin_lag, w = pair_at(surface + l);
        const auto leaves = (tip > w) | (both(s) * cos_lag - both(c) * sin_lag <= both(kWall));
        pair_at(surface + l) = leaves ? tip : w;
      }
    } else {
      const double low_feed_m = feed[low], high_feed_m = feed[high];
      for (std::size_t l = low; l < last; l += 2, ++layer) {
        const Pair cos_lag = pair_at(layer->cosine), sin_lag = pair_at(layer->sine);
        const Pair tip = reach + a * cos_lag + b * sin_lag;
        const Pair sine = both(s) * cos_lag - both(c) * sin_lag;
        const Pair cosine = both(c) * cos_lag + both(s) * sin_lag;
        const Pair w = pair_at(surface + l), then = pair_at(feed + l);
        const Pair chip =
            tip - w + trochoid_term(both(x) - then, sine, cosine, feed_per_rad_m_, radius_m_);
        // Behind the axis the feed leaves the surface: the last tooth is the one that counts.
        const auto leaves = (chip > Pair{}) | (sine < Pair{});
        pair_at(surface + l) = leaves ? tip : w;
        pair_at(feed + l) = leaves ? both(x) : then;
      }
      if (low_back) feed[low] = low_feed_m;
      if (high_back) feed[high] = high_feed_m;
    }
    if (low_back) surface[low] = low_m;
    if (high_back) surface[high] = high_m;
  }
}

// Adds what a tooth has in the cut. True if that is something.
template <std::size_t kEffects>
[[gnu::always_inline]] inline bool LayeredCut::add_tooth(const Tooth& tooth, const Moment& now,
                                                         Sums& sums) const {
  Place place;
  place.share = tooth.share;
  place.throw_m = tooth.throw_m;
  place.row = tooth.row;
  place.next = tooth.row + 1 == rows_ ? 0 : tooth.row + 1;
  // The chord between the two rows, see the header.
  const double* const s = &row_sin_[tooth.row];
  const double* const c = &row_cos_[tooth.row];
  place.sine = s[0] + tooth.share * (s[1] - s[0]);
  place.cosine = c[0] + tooth.share * (c[1] - c[0]);
  bool cutting = false;
  const double phi =
      (static_cast<double>(static_cast<std::int64_t>(tooth.row)) + tooth.share) * row_rad_;
  for (std::uint32_t p = first_pass_[tooth.row]; p < first_pass_[tooth.row + 1]; ++p) {
    const double tip = phi + passes_[p].turn_rad;
    for (const Engagement& arc : now.arcs) {
      place.low_m = tooth.intact_from_m;
      place.high_m = depth_m_;
      if (!straight_) {
        place.low_m = std::max(place.low_m, (tip - arc.exit_rad) * height_per_rad_);
        place.high_m = std::min(place.high_m, (tip - arc.start_rad) * height_per_rad_);
      } else if (now.blur_rad > 0) {
        // A straight tooth enters and leaves within one step: count the part of it that is in.
        place.part = (std::min(tip + now.blur_rad / 2, arc.exit_rad) -
                      std::max(tip - now.blur_rad / 2, arc.start_rad)) /
                     now.blur_rad;
        if (!(place.part > 0)) continue;
      } else if (tip < arc.start_rad || tip > arc.exit_rad) {
        continue;
      }
      if (!(place.low_m < place.high_m)) continue;
      place.first = layer_at(place.low_m);
      place.last = layer_at(place.high_m);
      if (cut<kEffects>(place, now, sums)) cutting = true;
    }
  }
  return cutting;
}

// Adds the layers of a tooth, as far as they are in an arc. True if there is a chip.
template <std::size_t kEffects>
[[gnu::always_inline]] inline bool LayeredCut::cut(const Place& place, const Moment& now,
                                                   Sums& sums) const {
  constexpr bool kWithEdges = (kEffects & kEdges) != 0, kOfWedge = (kEffects & kWedge) != 0;
  constexpr bool kWithOthers = (kEffects & kOthers) != 0;
  constexpr bool kOnTrochoid = (kEffects & kTrochoid) != 0;
  const Axis& axis = now.axis;
  const Pair reach = both(place.throw_m), share = both(place.share);
  const Pair a = both(axis.x_m * place.sine + axis.y_m * place.cosine);
  const Pair b = both(axis.y_m * place.sine - axis.x_m * place.cosine);
  double damping = 0;
  if constexpr (kWithOthers)
    if (now.cutting_speed_m_s > 0) damping = law_.process_damping_N_per_m / now.cutting_speed_m_s;
  const auto between = [&](const std::vector<double>& store, std::size_t l) {
    const Pair before = pair_at(store.data() + place.row * stride_ + l);
    const Pair after = pair_at(store.data() + place.next * stride_ + l);
    return before + share * (after - before);
  };
  Moments chip, edge, drag;
  const auto take = [&](std::size_t pair, auto ends) {
    const LayerPair& layer = layer_[pair];
    const Pair cos_lag = pair_at(layer.cosine), sin_lag = pair_at(layer.sine);
    Pair sine{}, cosine{};
    if constexpr (kOfWedge || kWithOthers || kOnTrochoid)
      sine = both(place.sine) * cos_lag - both(place.cosine) * sin_lag;
    if constexpr (kWithOthers || kOnTrochoid)
      cosine = both(place.cosine) * cos_lag + both(place.sine) * sin_lag;
    Pair width = pair_at(layer.width_m);
    if constexpr (ends() || kOfWedge) {
      const Pair bottom = pair_at(layer.bottom_m);
      Pair top = lower(bottom + width, both(place.high_m));
      if constexpr (kOfWedge)
        top = lower(top, both(front_depth_m_ + depth_slope_ * axis.x_m) +
                             both(depth_slope_ * radius_m_) * sine);
      width = higher(top - higher(bottom, both(place.low_m)), Pair{});
    }
    const Pair left = between(surface_m_, 2 * pair), tip = reach + a * cos_lag + b * sin_lag;
    Pair thickness;
    if constexpr (kOnTrochoid)
      thickness = higher(tip - left +
                             trochoid_term(both(axis.x_m) - between(surface_feed_m_, 2 * pair),
                                           sine, cosine, feed_per_rad_m_, radius_m_),
                         Pair{});
    else
      thickness = higher(tip, left) - left;
    const Pair length = (Pair)((thickness > Pair{}) & (PairMask)width);
    if constexpr (kWithEdges) edge.add(length, cos_lag, sin_lag);
    if constexpr (kWithOthers)
      drag.add(both(damping) * (both(axis.vx_m_s) * sine + both(axis.vy_m_s) * cosine) * length,
               cos_lag, sin_lag);
    if constexpr (kWithOthers)
      if (law_.size_effect_exponent != 0)
        for (int i = 0; i < 2; ++i)
          if (thickness[i] > 0 && width[i] > 0)
            thickness[i] *=
                std::pow(thickness[i] / law_.size_effect_reference_m, -law_.size_effect_exponent);
    chip.add(thickness * width, cos_lag, sin_lag);
  };
  // Only the first and the last layer may be partly in the cut.
  const std::size_t first = place.first / 2, last = place.last / 2;
  take(first, std::true_type{});
  for (std::size_t pair = first + 1; pair < last; ++pair) take(pair, std::false_type{});
  if (first != last) take(last, std::true_type{});

  const auto add = [&](Moments& moments, Moments& to) {
    if (straight_) moments *= place.part;
    to.add(moments, place.cosine, place.sine);
  };
  add(chip, sums.chip);
  if constexpr (kWithEdges) add(edge, sums.edge);
  if constexpr (kWithOthers) add(drag, sums.drag);
  return total(chip.plain) > 0;
}

}  // namespace servosense
