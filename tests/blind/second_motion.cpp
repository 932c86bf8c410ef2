#include "second_motion.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <vector>

namespace blind::second {
namespace {

constexpr double kPi = std::numbers::pi;

/// What a lap is made of.
enum class Part { strokes, pick, multisine, contour, small, random, speeds, ramps, wobble, turns };

/// One part of a program, within `seconds` and back to `home`.
void add_part(Path& path, Part part, Draw& draw, const Limits& l, double home, double seconds,
              bool dwells) {
  const double end = path.seconds() + seconds;
  const double speed = l.speed, most = l.acceleration;
  const auto pause = [&](double longest) {
    if (dwells) path.dwell(draw.uniform(0.05, longest));
  };
  const auto back = [&] {
    if (std::abs(path.at() - home) > 1e-9 * l.stroke) path.move(home - path.at(), speed, most);
  };
  switch (part) {
    case Part::strokes: {
      // Constant speeds, slow to fast, there and back.
      const double slowest = speed * draw.log_uniform(0.005, 0.05);
      const double share = draw.uniform(0.5, 0.95);
      for (int i = 0; i < 5 || (path.seconds() < end && i < 40); ++i) {
        const int turn = i % 5;
        const double feed = turn == 4 ? speed : slowest * std::pow(speed / slowest, turn / 4.0);
        const double way = std::min(share * l.stroke, feed * std::max(0.08 * seconds, 0.3));
        path.move(way, feed, most * draw.uniform(0.6, 1));
        pause(0.3);
        path.move(-way, feed, most * draw.uniform(0.6, 1));
        pause(0.3);
      }
      return back();
    }
    case Part::pick: {
      const double far = l.stroke * draw.uniform(0.3, 0.9);
      const double near = l.stroke * draw.uniform(0.01, 0.04);
      const double creep = speed * draw.log_uniform(0.01, 0.06);
      while (path.seconds() < end) {
        path.move(far, speed * draw.uniform(0.7, 1), most);
        path.move(near, creep, most / 3);
        pause(0.25);
        path.move(-near, 2 * creep, most / 3);
        path.move(home + l.stroke * draw.uniform(0, 0.05) - path.at(), speed, most);
        pause(0.25);
      }
      return back();
    }
    case Part::multisine: {
      Signal speeds, hertz;
      const std::size_t lines = 3 + draw.below(6);
      for (std::size_t i = 0; i < lines; ++i) {
        hertz.push_back(draw.log_uniform(0.15, 9));
        speeds.push_back(std::min(0.8 * speed / std::sqrt(static_cast<double>(lines)),
                                  0.5 * most / (2 * kPi * hertz.back())));
        speeds.back() = std::min(
            speeds.back(), 0.4 * l.stroke * 2 * kPi * hertz.back() / static_cast<double>(lines));
      }
      path.swing(speeds, hertz, seconds);
      return back();
    }
    case Part::contour:
      // Circles and arcs: one axis of them.
      while (path.seconds() < end) {
        const double radius = l.stroke * draw.log_uniform(0.01, 0.4);
        const double feed =
            std::min(speed * draw.log_uniform(0.03, 1), std::sqrt(0.7 * most * radius));
        const double hertz = feed / (2 * kPi * radius);
        const double rounds = hertz < 0.15 ? 1 : 2 + static_cast<double>(draw.below(3));
        path.swing({feed}, {hertz}, std::min(rounds / hertz, 0.6 * seconds));
        pause(0.2);
      }
      return back();
    case Part::small:
      // To and fro by little, as when backlash and friction are looked for.
      while (path.seconds() < end) {
        const double way = l.stroke * draw.log_uniform(3e-4, 1e-2);
        const double feed = std::max(std::min(speed * draw.log_uniform(0.003, 0.1), way * 6),
                                     way / (0.08 * seconds));
        const int times = 1 + static_cast<int>(draw.below(3));
        for (int i = 0; i < times; ++i) {
          path.move(way, feed, most / 2);
          pause(0.15);
          path.move(-way, feed, most / 2);
          pause(0.15);
        }
      }
      return back();
    case Part::random:
      while (path.seconds() < end) {
        const double target = home + l.stroke * draw.uniform(0, 0.95);
        const double feed = speed * draw.log_uniform(0.04, 1);
        const double way = target - path.at();
        // Not longer under way than a fifth of the part.
        path.move(way, std::max(feed, std::abs(way) / std::max(0.3 * seconds, 0.5)),
                  most * draw.uniform(0.4, 1));
        pause(0.3);
      }
      return back();
    case Part::speeds: {
      const double step = draw.uniform(0.25, 0.8);
      while (path.seconds() < end - step) {
        const double w = draw.sign() * speed * draw.log_uniform(0.03, 1);
        path.run(w, most * draw.uniform(0.5, 1), step * draw.uniform(0.7, 1.5));
        if (dwells && draw.chance(0.3)) {
          path.run(0, most, 0);
          path.dwell(draw.uniform(0.1, 0.3));
        }
      }
      path.run(0, most, 0);
      return;
    }
    case Part::ramps: {
      const double way = draw.sign();
      path.run(way * speed * draw.uniform(0.7, 1), most * draw.uniform(0.2, 0.6), 0.3);
      path.run(-way * speed * draw.uniform(0.7, 1), most * draw.uniform(0.2, 0.6), 0.3);
      path.run(0, most * draw.uniform(0.2, 0.6), 0);
      return;
    }
    case Part::wobble: {
      const double low = speed * draw.uniform(0.05, 0.4);
      path.run(low * draw.sign(), most, 0.2);
      path.run(0, most, 0);
      const double hertz = draw.log_uniform(0.3, 4);
      path.swing({std::min(low, 0.6 * most / (2 * kPi * hertz))}, {hertz}, 0.6 * seconds);
      return;
    }
    case Part::turns:
      while (path.seconds() < end) {
        const double way = draw.sign() * 2 * kPi * draw.log_uniform(0.02, 5);
        path.move(way, std::min(speed * draw.log_uniform(0.02, 0.3), 5 * std::abs(way)), most);
        pause(0.25);
      }
      return;
  }
}

}  // namespace

void Path::move(double way, double speed, double acceleration) {
  const double length = std::abs(way), start = at();
  if (length == 0) return;
  if (profile_ == Profile::sine_square) {
    // v = peak sin^2(pi t / T); the steepest slope is pi peak / T.
    double time = 2 * length / speed;
    time = std::max(time, std::sqrt(2 * kPi * length / acceleration));
    const auto n = static_cast<std::size_t>(std::ceil(time * rate_hz_));
    for (std::size_t k = 1; k <= n; ++k) {
      const double s = static_cast<double>(k) / static_cast<double>(n);
      q_.push_back(start + way * (s - std::sin(2 * kPi * s) / (2 * kPi)));
    }
    return;
  }
  const double peak = std::min(speed, std::sqrt(length * acceleration));
  const double rise = peak / acceleration, time = length / peak + rise;
  const auto n = static_cast<std::size_t>(std::ceil(time * rate_hz_));
  for (std::size_t k = 1; k <= n; ++k) {
    const double t = time * static_cast<double>(k) / static_cast<double>(n);
    const double left = time - t;
    const double gone = t < rise      ? 0.5 * acceleration * t * t
                        : left < rise ? length - 0.5 * acceleration * left * left
                                      : peak * (t - rise / 2);
    q_.push_back(start + (way > 0 ? gone : -gone));
  }
}

void Path::dwell(double seconds) {
  const auto n = static_cast<std::size_t>(seconds * rate_hz_);
  q_.insert(q_.end(), n, at());
}

void Path::run(double speed, double acceleration, double seconds) {
  const double rise = std::abs(speed - speed_) / acceleration;
  const auto n = static_cast<std::size_t>(std::ceil(rise * rate_hz_));
  for (std::size_t k = 1; k <= n; ++k) {
    const double part = (static_cast<double>(k) - 0.5) / static_cast<double>(n);
    q_.push_back(at() + (speed_ + (speed - speed_) * part) / rate_hz_);
  }
  speed_ = speed;
  const auto hold = static_cast<std::size_t>(seconds * rate_hz_);
  for (std::size_t k = 0; k < hold; ++k) q_.push_back(at() + speed / rate_hz_);
}

void Path::swing(const Signal& speeds, const Signal& hertz, double seconds) {
  const auto n = static_cast<std::size_t>(seconds * rate_hz_);
  // Slow swings are faded slowly, or the fading would be the fastest motion of all.
  const double slowest = *std::ranges::min_element(hertz);
  const double start = at(), fade = std::min(0.25 * seconds, std::max(0.4, 0.5 / slowest));
  for (std::size_t k = 1; k <= n; ++k) {
    const double t = static_cast<double>(k) / rate_hz_, edge = std::min({t, seconds - t, fade});
    const double in = std::sin(0.5 * kPi * std::max(edge, 0.0) / fade);
    double q = 0;
    for (std::size_t i = 0; i < speeds.size(); ++i) {
      const double w = 2 * kPi * hertz[i];
      q += speeds[i] / w * std::sin(w * t + 1.7 * static_cast<double>(i));
    }
    q_.push_back(start + in * in * q);
  }
}

void Path::round_off(double seconds) {
  const auto n = static_cast<std::size_t>(seconds * rate_hz_);
  if (n < 2) return;
  q_.insert(q_.end(), n, at());
  Signal mean(q_.size());
  double sum = static_cast<double>(n) * q_.front();
  for (std::size_t k = 0; k < q_.size(); ++k) {
    sum += q_[k] - (k >= n ? q_[k - n] : q_.front());
    mean[k] = sum / static_cast<double>(n);
  }
  q_ = std::move(mean);
}

double fastest(const Signal& path, double rate_hz) {
  double most = 0;
  for (std::size_t k = 1; k < path.size(); ++k)
    most = std::max(most, std::abs(path[k] - path[k - 1]) * rate_hz);
  return most;
}

Program program(Draw& draw, const Limits& l, double rate_hz, double seconds) {
  constexpr Part kAxisFirst[] = {Part::strokes, Part::strokes, Part::pick, Part::contour,
                                 Part::random};
  constexpr Part kAxis[] = {Part::strokes, Part::pick,  Part::multisine,
                            Part::contour, Part::small, Part::random};
  constexpr Part kSpindle[] = {Part::speeds, Part::ramps, Part::wobble, Part::turns};
  constexpr Profile kProfiles[] = {Profile::trapezoid, Profile::s_curve, Profile::sine_square};
  const Profile profile = draw.one_of(kProfiles);
  const bool dwells = draw.chance(0.7), same = draw.chance(0.6);
  const double learn = seconds * draw.uniform(0.65, 0.72);
  const std::size_t laps =
      std::min<std::size_t>(1 + draw.below(4), static_cast<std::size_t>(1 + learn / 6));
  const double home = l.turns ? 0.0 : l.stroke * draw.uniform(-0.5, 0.1);
  Path path(rate_hz, home, profile);
  path.dwell(draw.uniform(0.1, 0.5));

  // Parts of a lap, so that each gets some seconds.
  const double lap = learn / static_cast<double>(laps);
  const auto count = std::clamp<std::size_t>(static_cast<std::size_t>(lap / 4), 1, 4);
  std::vector<Part> parts;
  for (std::size_t i = 0; i < count; ++i)
    parts.push_back(l.turns  ? (i == 0 ? Part::speeds : draw.one_of(kSpindle))
                    : i == 0 ? draw.one_of(kAxisFirst)
                             : draw.one_of(kAxis));
  const std::uint64_t lap_seed = draw.next();
  for (std::size_t k = 0; k < laps && path.seconds() < 0.9 * learn; ++k) {
    Draw of_lap(same ? lap_seed : lap_seed + k, "lap");
    for (const Part part : parts)
      add_part(path, part, of_lap, l, l.turns ? path.at() : home, lap / static_cast<double>(count),
               dwells);
    // No test leaves out the rapids.
    if (l.turns) {
      path.run(l.speed * of_lap.sign(), l.acceleration, 0.3);
      path.run(0, l.acceleration, 0);
    } else {
      const double way = l.stroke * of_lap.uniform(0.5, 0.9);
      path.move(way, l.speed, l.acceleration);
      path.move(-way, l.speed, l.acceleration);
    }
  }
  Program made;
  made.held_out_from_s = path.seconds();
  // At the end something that was not learnt from, by preference of another kind.
  Limits other = l;
  other.speed *= draw.uniform(0.6, 0.95);
  other.acceleration *= draw.uniform(0.6, 1);
  const double rest = std::max(seconds - path.seconds(), 0.25 * seconds);
  const std::size_t ends = rest > 6 ? 2 : 1;
  for (std::size_t i = 0; i < ends; ++i) {
    const Part part = l.turns  ? (i == 0 ? Part::speeds : draw.one_of(kSpindle))
                      : i == 0 ? Part::random
                               : draw.one_of(kAxis);
    add_part(path, part, draw, other, l.turns ? path.at() : home, rest / static_cast<double>(ends),
             dwells);
  }
  path.dwell(0.1);
  if (profile == Profile::s_curve)
    path.round_off(draw.uniform(0.01, 0.06));
  else if (profile == Profile::trapezoid && draw.chance(0.5))
    path.round_off(0.004);
  made.reference = path.positions();
  return made;
}

}  // namespace blind::second
