// What counts beside a larger effect, and beside friction whose law nobody knows: problems made by
// hand, of which the truth is known.
#include <cmath>
#include <random>

#include "check.hpp"
#include "servosense/reconcile/decide.hpp"

using namespace servosense::reconcile;

namespace {

constexpr double kPresliding = 1e-6;
constexpr double kNoise = 0.1;
constexpr double kRow_s = 3e-3;

/// Strokes of several lengths and speeds to and fro, 20 s of them twice.
struct Motion {
  Column position, velocity, acceleration, since, direction;
};

Motion motion_of(std::size_t rows) {
  Motion m;
  for (std::size_t i = 0; i < rows; ++i) {
    const double t = kRow_s * static_cast<double>(i);
    // Slow and fast reversals: 40 um/s to 40 mm/s at once.
    const double a = 1.3, b = 4.1;
    m.position.push_back(4e-3 * std::sin(a * t) + 1e-3 * std::sin(b * t));
    m.velocity.push_back(4e-3 * a * std::cos(a * t) + 1e-3 * b * std::cos(b * t));
    m.acceleration.push_back(-4e-3 * a * a * std::sin(a * t) - 1e-3 * b * b * std::sin(b * t));
    const bool turned = i > 0 && m.velocity[i] * m.velocity[i - 1] <= 0;
    const double travel = i > 0 ? std::abs(m.position[i] - m.position[i - 1]) : 0;
    m.since.push_back(i == 0 || turned ? 0 : m.since[i - 1] + travel);
    m.direction.push_back(m.velocity[i] < 0 ? -1 : 1);
  }
  return m;
}

/// A bristle of this travel, less the sign: what it lacks after each reversal.
Column bristle(const Motion& m, double travel) {
  Column c;
  for (std::size_t i = 0; i < m.since.size(); ++i)
    c.push_back(-2 * m.direction[i] * std::exp(-m.since[i] / travel));
  return c;
}

Problem problem_of(const Motion& m) {
  Problem p;
  p.unit = "N";
  p.row_period_s = kRow_s;
  p.noise_bandwidth_hz = 70;
  const std::size_t n = m.position.size();
  std::mt19937_64 random(7);
  std::normal_distribution<double> normal(0, kNoise);
  for (std::size_t i = 0; i < n; ++i) {
    p.time_s.push_back(kRow_s * static_cast<double>(i));
    p.target.push_back(normal(random) + 50 * m.direction[i]);
    p.usable.push_back(true);
    p.held_out.push_back(i > 2 * n / 3);
  }
  p.known = {{"friction", m.direction, 50, true}, {"mass", m.acceleration, 1, true}};
  p.coordinates = {{"velocity", "m/s", m.velocity, {}, 0, 24},
                   {"acceleration", "m/s2", m.acceleration, {}, 0, 24},
                   {"travel-since-reversal", "m", m.since, m.direction, 0, 24}};
  return p;
}

Candidate plain(const char* name, const Column& column) {
  Candidate c;
  c.name = name;
  c.where = "velocity";
  c.columns = [column](std::span<const double>) { return std::vector<Column>{column}; };
  c.meaning = [](std::span<const double>, std::span<const double> k) {
    return Meaning{{{"size", {k[0]}, {}}}, k[0] > 0 ? "" : "negative"};
  };
  return c;
}

Candidate presliding(const Motion& m) {
  Candidate c = plain("presliding", m.direction);
  c.where = "travel-since-reversal";
  c.memory = true;
  c.search = {{kPresliding, 100 * kPresliding, 12, true}};
  c.columns = [m](std::span<const double> theta) {
    return std::vector<Column>{bristle(m, theta[0])};
  };
  return c;
}

void add(Column& to, double factor, const Column& column) {
  for (std::size_t i = 0; i < to.size(); ++i) to[i] += factor * column[i];
}

bool named(const Decision& d, const char* name) {
  for (const FoundEffect& e : d.report.effects)
    if (e.name == name) return true;
  return false;
}

}  // namespace

int main() {
  const Motion m = motion_of(12000);
  const Column one(m.position.size(), 1.0);
  Options options;
  options.threads = 1;
  options.null_records = 4;
  options.resamples = 20;

  // A hundredth of a constant load's size, and unlike anything that a load leaves.
  {
    Problem p = problem_of(m);
    add(p.target, 200, one);
    add(p.target, 8, bristle(m, 40e-6));
    const Decision d = decide(p, {plain("load", one), presliding(m)}, options);
    CHECK(named(d, "load"));
    CHECK(named(d, "presliding"));
  }
  // Friction that swings over within a few presliding distances is none, however clearly it is
  // seen.
  {
    Problem p = problem_of(m);
    add(p.target, 200, one);
    add(p.target, 8, bristle(m, 3 * kPresliding));
    const Decision d = decide(p, {plain("load", one), presliding(m)}, options);
    CHECK(named(d, "load"));
    CHECK(!named(d, "presliding"));
  }
  // Two hundredths of a found law, by the law's own kind and only roughly by this one: what it
  // leaves, and nothing else.
  Column drag = m.velocity, square = m.velocity, rough = m.velocity;
  for (std::size_t i = 0; i < drag.size(); ++i) {
    square[i] = drag[i] * std::abs(drag[i]);
    rough[i] = square[i] * (1 + std::cos(0.7 * kRow_s * static_cast<double>(i)));
  }
  {
    Problem p = problem_of(m);
    add(p.target, 5e4, drag);
    add(p.target, 2e5, rough);
    const Decision d = decide(p, {plain("viscous", drag), plain("quadratic", square)}, options);
    CHECK(named(d, "viscous"));
    CHECK(!named(d, "quadratic"));
  }
  // Down to the noise by this one: it is there.
  {
    Problem p = problem_of(m);
    add(p.target, 5e4, drag);
    add(p.target, 2e5, square);
    const Decision d = decide(p, {plain("viscous", drag), plain("quadratic", square)}, options);
    CHECK(named(d, "viscous"));
    CHECK(named(d, "quadratic"));
  }
  // As much of it beside a load, which leaves nothing of that kind.
  {
    Problem p = problem_of(m);
    add(p.target, 200, one);
    add(p.target, 2e5, square);
    p.known.push_back({"viscous", drag, 1, true});
    const Decision d = decide(p, {plain("load", one), plain("quadratic", square)}, options);
    CHECK(named(d, "load"));
    CHECK(named(d, "quadratic"));
  }
  return check::done();
}
