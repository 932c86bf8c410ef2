// The second generator of cuts against what text books say of it.
#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>
#include <string>

#include "case.hpp"
#include "check.hpp"
#include "second_cut.hpp"

namespace {

using namespace blind::second_milling;

constexpr double kPi = std::numbers::pi;

Cutter plain(Direction direction, std::size_t teeth) {
  Cutter c;
  c.radius = 8e-3;
  c.teeth.resize(teeth);
  c.ktc = 1.8e9, c.krc = 0.7e9, c.kac = 0.3e9;
  c.kte = 2e4, c.kre = 3e4;
  c.depth = 2e-3;
  c.immersion = direction == Direction::slot ? 16e-3 : 5e-3;
  c.direction = direction;
  c.slices = 1;
  return c;
}

constexpr double kFeed = 1e-4, kSpeed = 2 * kPi * 50;
constexpr std::size_t kTurn = 3600;

Forces turns(const Cutter& c, std::size_t n, std::size_t per_turn = kTurn, double feed = kFeed) {
  return cut(c, 2 * kPi / kSpeed / static_cast<double>(per_turn), n * per_turn, [feed](double t) {
    Moment m;
    m.angle = kSpeed * t, m.speed = kSpeed, m.feed = feed;
    return m;
  });
}

double mean_of_last_turn(const std::vector<double>& f, std::size_t per_turn = kTurn) {
  double sum = 0;
  for (std::size_t i = f.size() - per_turn; i < f.size(); ++i) sum += f[i];
  return sum / static_cast<double>(per_turn);
}

/// Mean forces on the work at any immersion (Altintas, Manufacturing Automation, 2nd ed., 2.51:
/// those on the tool, the opposite), zero helix. A helix moves no mean.
void means() {
  for (const Direction direction : {Direction::slot, Direction::up, Direction::down})
    for (const double helix_deg : {0.0, 35.0})
      for (const int formulation : {0, 1, 2}) {
        Cutter c = plain(direction, 4);
        c.helix_rad = kPi / 180 * helix_deg;
        c.slices = 16;
        c.trochoid = formulation == 1;
        c.closed_form = formulation == 2;
        const auto [st, ex] = engagement(c, c.immersion);
        const double n = 4, a = c.depth, h = kFeed;
        const auto between = [st = st, ex = ex](auto f) { return f(ex) - f(st); };
        const double x = between([&](double p) {
          return n * a * h / (8 * kPi) *
                     (c.ktc * std::cos(2 * p) - c.krc * (2 * p - std::sin(2 * p))) +
                 n * a / (2 * kPi) * (-c.kte * std::sin(p) + c.kre * std::cos(p));
        });
        const double y = between([&](double p) {
          return n * a * h / (8 * kPi) *
                     (c.ktc * (2 * p - std::sin(2 * p)) + c.krc * std::cos(2 * p)) -
                 n * a / (2 * kPi) * (c.kte * std::cos(p) + c.kre * std::sin(p));
        });
        const Forces f = turns(c, 3);
        const double size = std::hypot(x, y);
        // A step is 0.1 degree: a tooth enters within it. The exact path differs from the circle by
        // the feed over the radius, a hundredth.
        const double within = (c.trochoid ? 0.012 : 0.003) * size;
        CHECK_NEAR(mean_of_last_turn(f.x), -x, within);
        CHECK_NEAR(mean_of_last_turn(f.y), -y, within);
      }
}

/// However the axis is off and the teeth placed, a turn takes all of the feed: in a slot cut by
/// tangential force alone, the mean force across is that of an even tool.
void feed_is_conserved() {
  for (const bool trochoid : {false, true}) {
    Cutter c = plain(Direction::slot, 3);
    c.krc = c.kac = c.kte = c.kre = 0;
    c.trochoid = trochoid;
    const double even = mean_of_last_turn(turns(c, 3).y);
    eccentric(c, 30e-6, 1.0);
    const Forces off = turns(c, 3);
    CHECK_NEAR(mean_of_last_turn(off.y), even, 2e-3 * std::abs(even));
    c.teeth[1].angle = 0.05;
    CHECK_NEAR(mean_of_last_turn(turns(c, 3).y), even, 2e-3 * std::abs(even));
    // One tooth gone: those left take the feed of all.
    c = plain(Direction::slot, 3);
    c.krc = c.kac = c.kte = c.kre = 0;
    c.trochoid = trochoid;
    c.teeth[2].gone = 1;
    const Forces broken = turns(c, 3);
    CHECK_NEAR(mean_of_last_turn(broken.y), even, 2e-3 * std::abs(even));
    const auto largest = [](const Forces& f) {
      double most = 0;
      for (std::size_t i = f.z.size() - kTurn; i < f.z.size(); ++i)
        most = std::max(most, std::hypot(f.x[i], f.y[i]));
      return most;
    };
    // The one behind the gap takes two chips.
    CHECK_BETWEEN(largest(broken) / (c.ktc * c.depth * kFeed), 1.95, 2.05);
    // A part of it: as high as it says, however few the slices and however low the part.
    for (const double helix_deg : {0.0, 30.0})
      for (const double gone : {0.06, 0.45})
        for (const bool closed_form : {false, true}) {
          if (closed_form && (trochoid || helix_deg == 0)) continue;
          c = plain(Direction::slot, 3);
          c.krc = c.kac = c.kte = c.kre = 0;
          c.trochoid = trochoid;
          c.closed_form = closed_form;
          c.helix_rad = kPi / 180 * helix_deg;
          c.slices = helix_deg == 0 ? 1 : 4;
          c.teeth[2].gone = gone;
          CHECK_NEAR(mean_of_last_turn(turns(c, 3).y), even, 2e-3 * std::abs(even));
        }
  }
}

/// Small vibration of a tool that meets one tooth at a time: the mode answers the tooth-passing
/// force by its receptance. With hardly any force from it on the chip, force is that of a rigid
/// tool; displacement is not recorded, so its largest is compared with the sum of harmonics.
void mode_answers() {
  Cutter c = plain(Direction::up, 4);
  c.kte = c.kre = 0;
  const Mode mode{'y', 430, 0.03, 400};
  const Forces rigid = turns(c, 3);
  c.modes = {mode};
  const Forces moved = turns(c, 40);
  CHECK_NEAR(mean_of_last_turn(moved.y), mean_of_last_turn(rigid.y),
             2e-3 * std::abs(mean_of_last_turn(rigid.y)));
  std::vector<double> displacement(kTurn, 0.0);
  for (int k = -60; k <= 60; ++k) {
    std::complex<double> line = 0;
    for (std::size_t i = 0; i < kTurn; ++i)
      line -= rigid.y[rigid.y.size() - kTurn + i] *
              std::polar(1.0 / kTurn, -2 * kPi * k * static_cast<double>(i) / kTurn);
    const double w = k * kSpeed, wn = 2 * kPi * mode.hz;
    line /= mode.mass_kg * std::complex<double>(wn * wn - w * w, 2 * mode.damping * wn * w);
    for (std::size_t i = 0; i < kTurn; ++i)
      displacement[i] +=
          (line * std::polar(1.0, 2 * kPi * k * static_cast<double>(i) / kTurn)).real();
  }
  double most = 0;
  for (const double d : displacement) most = std::max(most, std::abs(d));
  // From rest the first turns overshoot: at most twice.
  CHECK_BETWEEN(moved.largest_displacement, 0.98 * most, 2 * most);
}

/// Chatter grows beyond the least depth that is stable whatever the speed, and not below
/// (Tlusty; zero-order solution of Altintas and Budak 1995 for one mode in x):
/// Lambda = -N a Kt (1 - e^{-iwT}) / 4 pi, 1 + Lambda alpha_xx G = 0.
void limit_of_chatter() {
  Cutter c = plain(Direction::slot, 4);
  c.kte = c.kre = 0;
  const Mode mode{'x', 500, 0.03, 5};
  c.modes = {mode};
  // alpha_xx of a slot is -pi krc / ktc.
  const double kr = c.krc / c.ktc, wn = 2 * kPi * mode.hz;
  const double k = mode.mass_kg * wn * wn;
  const double least_real = -1 / (4 * k * mode.damping * (1 + mode.damping));
  const double limit = -1 / (2 * (4.0 / (4 * kPi)) * c.ktc * kPi * kr * least_real);
  const auto grows = [&](double depth, bool memory) {
    Cutter d = c;
    d.depth = depth;
    d.regeneration = memory;
    const Forces f = turns(d, 60, 720);
    double late = 0, most = 0;  // of what does not repeat, of all
    for (std::size_t i = f.x.size() - 720 * 10; i < f.x.size(); ++i) {
      late = std::max(late, std::abs(f.x[i] - f.x[i - 720]));
      most = std::max(most, std::abs(f.x[i]));
    }
    return late > 0.1 * most;
  };
  CHECK(!grows(0.6 * limit, true));
  CHECK(!grows(1.6 * limit, false));
  // Beyond all lobes; the best pocket of these speeds is not three times as deep.
  CHECK(grows(4 * limit, true));
}

/// A force of the process that opposes the speed adds damping: chatter stops.
void damping_by_the_flank() {
  Cutter c = plain(Direction::slot, 4);
  c.kte = c.kre = 0;
  c.modes = {{'x', 500, 0.03, 5}};
  const auto unrest = [&](double ploughing) {
    Cutter d = c;
    d.ploughing = ploughing;
    const Forces f = turns(d, 30, 720);
    double most = 0;
    for (std::size_t i = f.x.size() - 7200; i < f.x.size(); ++i)
      most = std::max(most, std::abs(f.x[i] - f.x[i - 720]));
    return most;
  };
  c.depth = 1e-3;
  CHECK(unrest(5e5) < unrest(0));
}

/// The sensor's mode has the gain of its closed form at its own frequency and far below.
void sensor() {
  const double step = 1e-5, damping = 0.02;
  for (const double hz : {20.0, 400.0, 700.0}) {
    std::vector<double> f(200000);
    for (std::size_t i = 0; i < f.size(); ++i)
      f[i] = std::sin(2 * kPi * hz * step * static_cast<double>(i));
    ring(f, step, 400, damping);
    double most = 0;
    for (std::size_t i = f.size() / 2; i < f.size(); ++i) most = std::max(most, std::abs(f[i]));
    const double r = hz / 400;
    const double gain = 1 / std::hypot(1 - r * r, 2 * damping * r);
    // Held over a step of 1/250 of the period.
    CHECK_NEAR(most / gain, 1.0, 0.02);
  }
}

/// Half the step and twice the slices change the forces by little, and the two formulations of a
/// circle agree.
void converges() {
  Cutter c = plain(Direction::down, 5);
  c.helix_rad = kPi / 6;
  c.slices = 12;
  c.teeth[2].angle = 0.03;
  eccentric(c, 20e-6, 2.0);
  c.modes = {{'x', 700, 0.04, 2}, {'y', 500, 0.04, 3}};
  const auto apart = [](const Forces& a, std::size_t every_a, const Forces& b,
                        std::size_t every_b) {
    double off = 0, all = 0;
    for (std::size_t i = 0; i < 720; ++i) {
      const double of_a = a.x[a.x.size() - 720 * every_a + i * every_a];
      const double of_b = b.x[b.x.size() - 720 * every_b + i * every_b];
      off += (of_a - of_b) * (of_a - of_b);
      all += of_b * of_b;
    }
    return std::sqrt(off / all);
  };
  for (const bool trochoid : {false, true}) {
    c.trochoid = trochoid;
    Cutter fine = c;
    fine.slices = 24;
    const Forces coarse = turns(c, 8, 720);
    CHECK_BETWEEN(apart(coarse, 1, turns(fine, 8, 1440), 2), 1e-9, 0.02);
    // Circle and exact path differ by feed over radius, and more where the tooth before is another.
    Cutter rigid = c;
    rigid.modes.clear();
    Cutter integral = rigid;
    integral.closed_form = true;
    integral.trochoid = false;
    CHECK_BETWEEN(apart(turns(rigid, 3, 720), 1, turns(integral, 3, 720), 1), 1e-9,
                  trochoid ? 0.06 : 0.02);
  }
}

/// The same seed twice; another seed is another machine; nothing in a null, and what is asked for
/// in the others. At night of every cell, otherwise of every fourth.
void cases(bool nightly) {
  std::size_t at = 0;
  for (const std::string& cell : blind::second_milling_cells()) {
    if (!nightly && at++ % 4 != 0) continue;
    const blind::Case a = blind::draw_case(cell, 11, "plain");
    const blind::Case b = blind::draw_case(cell, 11, "plain");
    CHECK(a.machine == b.machine && blind::truth_json(a) == blind::truth_json(b));
    bool same = a.columns.size() == b.columns.size();
    for (std::size_t i = 0; same && i < a.columns.size(); ++i)
      same = a.columns[i].values == b.columns[i].values;
    CHECK(same);
    CHECK(blind::draw_case(cell, 12, "plain").machine != a.machine);
    const bool null = cell.find("/null") != std::string::npos;
    CHECK(a.truth.effects.size() == (null ? 0u : cell.ends_with("/pair") ? 2u : 1u));
    CHECK(a.name.starts_with(cell));
    for (const blind::Column& column : a.columns)
      CHECK(std::ranges::all_of(column.values, [](double v) { return std::isfinite(v); }));
    CHECK(a.columns[0].values.size() > 1000 && a.columns[0].values.size() < 130000);
  }
}

}  // namespace

int main(int argc, char** argv) {
  const bool nightly = check::nightly(argc, argv);
  means();
  feed_is_conserved();
  mode_answers();
  limit_of_chatter();
  damping_by_the_flank();
  sensor();
  converges();
  cases(nightly);
  return check::done();
}
