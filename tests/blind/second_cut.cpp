#include "second_cut.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace blind::second_milling {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr int kPieces = 4;  // of the integral over an edge

/// x'' + 2 z w x' + w^2 x = a for a step of constant a, exactly.
class Oscillator {
 public:
  Oscillator(double hz, double damping, double step_s) {
    const double w = 2 * kPi * hz, d = w * std::sqrt(1 - damping * damping);
    const double fade = std::exp(-damping * w * step_s);
    const double c = fade * std::cos(d * step_s), s = fade * std::sin(d * step_s) / d;
    w2_ = w * w;
    xx_ = c + damping * w * s, xv_ = s;
    vx_ = -w2_ * s, vv_ = c - damping * w * s;
  }
  void step(double acceleration) {
    const double rest = acceleration / w2_;
    const double from = x - rest;
    const double next = xx_ * from + xv_ * v;
    v = vx_ * from + vv_ * v;
    x = next + rest;
  }
  [[nodiscard]] double stiffness() const { return w2_; }
  double x = 0, v = 0;

 private:
  double w2_ = 1, xx_ = 1, xv_ = 0, vx_ = 0, vv_ = 1;
};

struct Vector {
  double x = 0, y = 0, z = 0;
};

/// Where the axis of the cutter has been.
struct History {
  double step_s;
  double first_speed = 0;  ///< of the feed before the record
  std::vector<double> feed, x, y;

  [[nodiscard]] Vector at(double t, bool vibration) const {
    const double place = t / step_s;
    if (place <= 0) return {feed.front() + first_speed * t, 0, 0};
    const auto i = std::min(static_cast<std::size_t>(place), feed.size() - 1);
    const std::size_t next = std::min(i + 1, feed.size() - 1);
    const double f = place - static_cast<double>(i);
    const auto between = [&](const std::vector<double>& v) { return v[i] + f * (v[next] - v[i]); };
    Vector p{between(feed), 0, 0};
    if (vibration) p.x += between(x), p.y = between(y);
    return p;
  }
};

/// A tooth and the ones before it at an instant.
struct Passing {
  std::size_t tooth;
  double lead;  ///< angle by which it went ahead
  double shorter;
  double reach;
  Vector moved;  ///< of the axis since it stood where the tooth is
};

class Run {
 public:
  Run(const Cutter& c, double step_s) : c_(c), step_s_(step_s), history_{step_s, 0, {}, {}, {}} {
    for (const Mode& m : c.modes) oscillators_.emplace_back(m.hz, m.damping, step_s);
    uneven_ = !c.modes.empty();
    for (const Tooth& t : c.teeth) uneven_ = uneven_ || t.angle != 0 || t.reach != 0 || t.gone != 0;
  }

  Vector step(double t, const Moment& m) {
    const double table = m.feed * static_cast<double>(c_.teeth.size()) * m.speed / (2 * kPi);
    if (history_.feed.empty()) {
      history_.first_speed = table;
      history_.feed.push_back(0);
    } else {
      history_.feed.push_back(history_.feed.back() + table * step_s_);
    }
    Vector place{}, speed{};
    for (std::size_t i = 0; i < oscillators_.size(); ++i) {
      (c_.modes[i].axis == 'x' ? place.x : place.y) += oscillators_[i].x;
      (c_.modes[i].axis == 'x' ? speed.x : speed.y) += oscillators_[i].v;
    }
    history_.x.push_back(place.x);
    history_.y.push_back(place.y);
    largest = std::max(largest, std::hypot(place.x, place.y));
    speed_ = speed;

    Vector force{};
    if (m.cutting) {
      window_ = engagement(c_, c_.immersion * m.immersion);
      for (std::size_t j = 0; j < c_.teeth.size(); ++j) add_tooth(j, t, m, force);
    }
    for (std::size_t i = 0; i < oscillators_.size(); ++i)
      oscillators_[i].step(-(c_.modes[i].axis == 'x' ? force.x : force.y) / c_.modes[i].mass_kg);
    return force;
  }

  double largest = 0;

 private:
  void add_tooth(std::size_t j, double t, const Moment& m, Vector& force) {
    const auto n = static_cast<double>(c_.teeth.size());
    const Tooth& tooth = c_.teeth[j];
    const double depth = c_.depth * m.depth;
    const double twist = std::tan(c_.helix_rad) / c_.radius;
    const double tip = m.angle - static_cast<double>(j) * 2 * kPi / n + tooth.angle;
    const double low = tooth.gone * depth;
    if (low >= depth) return;
    // Nothing of the edge in the work, of whatever turn?
    const double first = tip - twist * depth, last = tip - twist * low;
    const double turn = 2 * kPi * std::floor((last - window_.first) / (2 * kPi));
    if (first - turn > window_.second) return;

    passings_.clear();
    // An even tool that stands still meets only the tooth before.
    const std::size_t memory = uneven_ ? c_.teeth.size() : 1;
    now_ = history_.at(t, true);
    for (std::size_t k = 1; k <= memory; ++k) {
      const std::size_t before = (j + c_.teeth.size() - k) % c_.teeth.size();
      const double lead =
          static_cast<double>(k) * 2 * kPi / n + c_.teeth[before].angle - tooth.angle;
      const Vector then = history_.at(t - lead / m.speed, c_.regeneration);
      passings_.push_back({before,
                           lead,
                           tooth.reach - c_.teeth[before].reach,
                           c_.teeth[before].reach,
                           {now_.x - then.x, now_.y - then.y, 0}});
    }
    vc_ = m.speed * c_.radius;
    // One by one where another tooth has lost its edge: what that one leaves is as high as it says,
    // however few the slices.
    heights_ = {low, depth};
    for (const Tooth& other : c_.teeth)
      if (other.gone * depth > low && other.gone < 1) heights_.push_back(other.gone * depth);
    std::ranges::sort(heights_);
    for (std::size_t k = 0; k + 1 < heights_.size(); ++k) {
      const double from = heights_[k], to = heights_[k + 1];
      if (!(to > from)) continue;
      const double part = (to - from) / (depth - low);
      if (c_.closed_form && c_.exponent == 0 && twist > 1e-6)
        by_integral(tip, twist, from, to, t, m, m.tooth[j], force);
      else
        by_slices(tip, twist, from, to,
                  std::max(1, static_cast<int>(std::lround(part * c_.slices))), t, m, m.tooth[j],
                  force);
    }
  }

  /// Chip thickness before a tooth whose angle has this sine and cosine, and whose surface it cuts.
  double chip(double s, double c, double z, double t, const Moment& m, std::size_t& whose) const {
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < passings_.size(); ++i) {
      const Passing& p = passings_[i];
      if (z < c_.teeth[p.tooth].gone * c_.depth * m.depth) continue;
      double h = p.shorter + p.moved.x * s + p.moved.y * c;
      if (c_.trochoid) {
        // The point of the older path on this ray was cut a little before or after.
        const double radius = c_.radius + p.reach;
        Vector moved = p.moved;
        const double off = (moved.x * c - moved.y * s) / radius;
        const Vector then = history_.at(t - (p.lead - off) / m.speed, c_.regeneration);
        moved = {now_.x - then.x, now_.y - then.y, 0};
        h = p.shorter + moved.x * s + moved.y * c + 0.5 * radius * off * off;
      }
      if (h < least) least = h, whose = i;
    }
    // All before it lack their edge there: what a turn of feed leaves.
    if (!std::isfinite(least)) least = static_cast<double>(c_.teeth.size()) * m.feed * s;
    return least;
  }

  [[nodiscard]] bool in_work(double phi, double s) const {
    const double wrapped = phi - 2 * kPi * std::floor(phi / (2 * kPi));
    if (wrapped < window_.first || wrapped > window_.second) return false;
    const double x = now_.x + c_.radius * s;
    return x > c_.face && x < c_.end;
  }

  void by_slices(double tip, double twist, double low, double high, int slices, double t,
                 const Moment& m, double share, Vector& force) const {
    const double dz = (high - low) / slices;
    for (int i = 0; i < slices; ++i) {
      const double z = low + (i + 0.5) * dz;
      const double phi = tip - twist * z;
      const double s = std::sin(phi), c = std::cos(phi);
      if (!in_work(phi, s)) continue;
      std::size_t whose = 0;
      const double h = chip(s, c, z, t, m, whose);
      if (h <= 0) continue;
      const double scale =
          share * m.hardness *
          (c_.exponent == 0 ? 1.0 : std::pow(std::max(h, 1e-7) / c_.thickness, -c_.exponent));
      const double rub = c_.ploughing * (speed_.x * s + speed_.y * c) / vc_;
      const double ft = (c_.ktc * scale * h + c_.kte + m.wear_t + 0.3 * rub) * dz;
      const double fr = (c_.krc * scale * h + c_.kre + m.wear_r + rub) * dz;
      force.x += ft * c + fr * s;
      force.y += -ft * s + fr * c;
      force.z -= c_.kac * scale * h * dz;
    }
  }

  /// The chip along the edge is a sine plus a constant, so force has an integral; in pieces, as the
  /// tooth before may be another one higher up.
  void by_integral(double tip, double twist, double low, double high, double t, const Moment& m,
                   double share, Vector& force) const {
    const double first = tip - twist * high, last = tip - twist * low;
    const double down = 2 * kPi * std::floor((last - window_.first) / (2 * kPi));
    for (const double turn : {down - 2 * kPi, down}) {
      const double a = std::max(first - turn, window_.first);
      const double b = std::min(last - turn, window_.second);
      if (b <= a) continue;
      for (int i = 0; i < kPieces; ++i) {
        const double from = a + (b - a) * i / kPieces, to = a + (b - a) * (i + 1) / kPieces;
        const double mid = 0.5 * (from + to), s = std::sin(mid), c = std::cos(mid);
        if (!in_work(mid, s)) continue;
        std::size_t whose = 0;
        const double z = (last - turn - mid) / twist + low;
        if (chip(s, c, z, t, m, whose) <= 0) continue;
        const Passing& p = passings_[whose];
        const double k = share * m.hardness;
        const double rub = c_.ploughing / vc_;
        // Per length of edge: a sin + b cos + c, tangential and radial.
        const double ft[3]{c_.ktc * k * p.moved.x + 0.3 * rub * speed_.x,
                           c_.ktc * k * p.moved.y + 0.3 * rub * speed_.y,
                           c_.ktc * k * p.shorter + c_.kte + m.wear_t};
        const double fr[3]{c_.krc * k * p.moved.x + rub * speed_.x,
                           c_.krc * k * p.moved.y + rub * speed_.y,
                           c_.krc * k * p.shorter + c_.kre + m.wear_r};
        const double cs = std::cos(from) - std::cos(to), sn = std::sin(to) - std::sin(from);
        const double ss = 0.5 * (to - from) - 0.25 * (std::sin(2 * to) - std::sin(2 * from));
        const double cc = to - from - ss;
        const double sc = 0.25 * (std::cos(2 * from) - std::cos(2 * to));
        const auto times_sin = [&](const double* q) { return q[0] * ss + q[1] * sc + q[2] * cs; };
        const auto times_cos = [&](const double* q) { return q[0] * sc + q[1] * cc + q[2] * sn; };
        force.x += (times_cos(ft) + times_sin(fr)) / twist;
        force.y += (-times_sin(ft) + times_cos(fr)) / twist;
        force.z -= c_.kac * k * (p.moved.x * cs + p.moved.y * sn + p.shorter * (to - from)) / twist;
      }
    }
  }

  const Cutter& c_;
  double step_s_;
  History history_;
  std::vector<Oscillator> oscillators_;
  bool uneven_ = false;
  std::pair<double, double> window_;
  std::vector<Passing> passings_;
  std::vector<double> heights_;
  Vector speed_{}, now_{};
  double vc_ = 1;
};

}  // namespace

std::pair<double, double> engagement(const Cutter& c, double immersion) {
  const double swept = std::acos(std::clamp(1 - immersion / c.radius, -1.0, 1.0));
  if (c.direction == Direction::slot) return {0, kPi};
  if (c.direction == Direction::up) return {0, swept};
  return {kPi - swept, kPi};
}

void eccentric(Cutter& c, double offset_m, double angle_rad) {
  const auto n = static_cast<double>(c.teeth.size());
  for (std::size_t j = 0; j < c.teeth.size(); ++j)
    c.teeth[j].reach += offset_m * std::cos(angle_rad - static_cast<double>(j) * 2 * kPi / n);
}

Forces cut(const Cutter& c, double step_s, std::size_t steps,
           const std::function<Moment(double t)>& at) {
  Run run(c, step_s);
  Forces f;
  f.x.reserve(steps), f.y.reserve(steps), f.z.reserve(steps);
  for (std::size_t i = 0; i < steps; ++i) {
    const double t = static_cast<double>(i) * step_s;
    const Vector force = run.step(t, at(t));
    f.x.push_back(force.x);
    f.y.push_back(force.y);
    f.z.push_back(force.z);
  }
  f.largest_displacement = run.largest;
  return f;
}

void ring(std::vector<double>& force, double step_s, double hz, double damping, double share) {
  Oscillator mode(hz, damping, step_s);
  for (double& f : force) {
    const double seen = mode.stiffness() * mode.x;
    mode.step(f);
    f += share * (seen - f);
  }
}

}  // namespace blind::second_milling
