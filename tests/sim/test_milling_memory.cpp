// Memory of a long milling run: taken at the start, whatever the duration.
#include <cmath>
#include <cstdlib>
#include <new>
#include <vector>

#include "check.hpp"
#include "servosense/sim/milling_simulator.hpp"

namespace {
std::size_t held = 0, allocations = 0;  // blocks not yet freed, and all there have been
bool counting = false;

void* take(std::size_t size, std::size_t alignment) {
  void* block = std::aligned_alloc(alignment, (size + alignment - 1) / alignment * alignment);
  if (block == nullptr) throw std::bad_alloc();
  ++held;
  if (counting) {
    ++allocations;
  }
  return block;
}
void give(void* block) {
  if (block == nullptr) return;
  --held;
  std::free(block);
}
}  // namespace

void* operator new(std::size_t size) { return take(size, __STDCPP_DEFAULT_NEW_ALIGNMENT__); }
void* operator new(std::size_t size, std::align_val_t alignment) {
  return take(size, static_cast<std::size_t>(alignment));
}
void operator delete(void* block) noexcept { give(block); }
void operator delete(void* block, std::size_t) noexcept { give(block); }
void operator delete(void* block, std::align_val_t) noexcept { give(block); }
void operator delete(void* block, std::size_t, std::align_val_t) noexcept { give(block); }

using namespace servosense;

namespace {

MillingSimulation finishing_cut() {
  MillingSimulation s;
  s.tool.diameter_m = 10e-3;
  s.tool.teeth = 2;
  s.tool.helix_deg = 30;
  s.tool.force.tangential_coefficient_N_per_m2 = 1500e6;
  s.tool.force.radial_ratio = 1.0 / 3;
  s.cut = {8000, 87.5e-6, 2e-3, 0.5e-3, MillingDirection::down};
  s.structure.x = s.structure.y = {{2082, 0.018, 0.043}};
  s.layers = 8;
  s.step_s = 4e-6;
  return s;
}

// A tenth of a metre is cut until the wall has as many points as are kept; then half a metre more,
// more, without a single allocation.
void no_allocation_on_the_way() {
  MillingSimulation s = finishing_cut();
  s.wall_points = 1 << 14;  // 36 mm of wall
  auto simulator = MillingSimulator::create(s);
  CHECK(simulator.has_value());
  if (!simulator) return;
  const auto cut_to = [&](double feed_m) {
    while (simulator->now().feed_m < feed_m) simulator->step();
  };
  cut_to(0.1);
  const std::size_t blocks = held;
  counting = true;
  cut_to(0.6);
  counting = false;
  check::figure("revolutions cut", simulator->now().angle_rad / kTwoPi);
  check::figure("allocations on the way", static_cast<double>(allocations));
  CHECK(allocations == 0);
  CHECK(held == blocks);

  // What is kept is the end of the wall, as a wall kept whole has it.
  const WallProfile& latest = simulator->surface().wall(0);
  CHECK(latest.height_m.size() <= s.wall_points && latest.height_m.size() >= s.wall_points / 2);
  s.wall_points = 1 << 20;
  auto other = MillingSimulator::create(s);
  CHECK(other.has_value());
  if (!other) return;
  while (other->now().feed_m < 0.6) other->step();
  const WallProfile& whole = other->surface().wall(0);
  const auto before = whole.height_m.size() - latest.height_m.size();
  CHECK(before > 200000);
  // The places of the points are rounded once more at every half let go: 1e-16 of the 0.6 m of
  // feed, 30 times, on slopes of up to 1/4 at the front.
  CHECK_NEAR(latest.first_x_m, whole.first_x_m + static_cast<double>(before) * whole.spacing_m,
             1e-14);
  double worst = 0;
  for (std::size_t i = 0; i < latest.height_m.size(); ++i)
    worst = std::max(worst, std::abs(latest.height_m[i] - whole.height_m[before + i]));
  CHECK_NEAR(worst, 0, 1e-14);
}

// A workpiece with an end and holes looks its engagement up anew as it goes, and keeps none of it.
void nothing_kept_of_arcs() {
  MillingSimulation s = finishing_cut();
  s.wall_points = 0;  // the least: two diameters
  s.workpiece.length_m = 0.3;
  s.workpiece.holes = {{0.1, 0, 4e-3}, {0.2, 1e-3, 2e-3}};
  auto simulator = MillingSimulator::create(s);
  CHECK(simulator.has_value());
  if (!simulator) return;
  while (simulator->now().feed_m < 0.06) simulator->step();
  const std::size_t blocks = held;
  while (simulator->now().feed_m < 0.26) simulator->step();
  CHECK(held == blocks);
  const std::vector<double>& wall = simulator->surface().wall(0).height_m;
  CHECK(static_cast<double>(wall.size()) * 87.5e-6 / 40 <= 2 * s.tool.diameter_m + 1e-5);
}

}  // namespace

int main() {
  no_allocation_on_the_way();
  nothing_kept_of_arcs();
  return check::done();
}
