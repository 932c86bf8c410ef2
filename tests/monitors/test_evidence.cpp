// Evidence of collision alarms: raised again bit for bit, in whatever phase of the recording they
// fell, however long ago, and whatever was wrong with the signal before.
#include <algorithm>
#include <bit>
#include <cstdint>
#include <memory>
#include <random>
#include <string>
#include <type_traits>

#include "check.hpp"
#include "servosense/monitors/collision.hpp"
#include "servosense/monitors/evidence.hpp"

namespace {

using namespace servosense;

template <typename Real>
using Bits = std::conditional_t<sizeof(Real) == 4, std::uint32_t, std::uint64_t>;

template <typename Real>
bool same_bits(Real a, Real b) {
  return std::bit_cast<Bits<Real>>(a) == std::bit_cast<Bits<Real>>(b);
}

CollisionConfig config() {
  CollisionConfig c;
  c.threshold_N_per_s = 5000;
  c.release_samples = 100;
  return c;
}

// What the monitor was at an alarm, noted while it ran.
template <typename Real>
struct Noted {
  std::uint64_t sample = 0;
  Real jerk = 0, level = 0;
  typename CollisionMonitor<Real>::State state;
  std::uint32_t over = 0;
};

template <typename Real>
bool replays(const CollisionMonitor<Real>& monitor, const Noted<Real>& noted) {
  // On another monitor of the same configuration, as a reader of a stored alarm has it.
  auto other = std::make_unique<CollisionMonitor<Real>>();
  other->configure(config());
  const auto e = monitor.evidence();
  const auto core = other->replay(e);
  const auto& s = core.state;
  bool ok = e.sample == noted.sample && s.state == MonitorState::alarm &&
            same_bits(s.jerk_N_per_s, noted.jerk) &&
            same_bits(core.alarm.state().value, noted.level) &&
            core.alarm.state().over_alarm == noted.over && s.alarms == noted.state.alarms &&
            s.faults == noted.state.faults && s.signal == noted.state.signal;
  // The last input alone raised it: one sample less, and there is none.
  auto shorter = e;
  --shorter.count;
  ok = ok && other->replay(shorter).state.state != MonitorState::alarm;
  // It reaches back at least a stride, unless the monitor is younger.
  constexpr std::uint64_t kStride = CollisionMonitor<Real>::kEvidenceStride;
  return ok && e.count <= 2 * kStride && e.count >= std::min<std::uint64_t>(e.sample, kStride + 1);
}

// Contacts that begin in every phase of the snapshots, on a noisy force; three of them a run, the
// evidence of each read at once, and as late as just before the next.
template <typename Real>
void every_phase() {
  constexpr int kStride = static_cast<int>(CollisionMonitor<Real>::kEvidenceStride);
  for (int phase = 0; phase < 2 * kStride; ++phase) {
    const unsigned seed = 500 + static_cast<unsigned>(phase);
    const std::string what = std::string(sizeof(Real) == 4 ? "float" : "double") + ", phase " +
                             std::to_string(phase) + ", seed " + std::to_string(seed);
    std::mt19937 random(seed);
    std::normal_distribution<double> noise(0, 0.3);
    auto monitor = std::make_unique<CollisionMonitor<Real>>();
    monitor->configure(config());
    monitor->stagger(static_cast<std::uint32_t>(phase * 7 % kStride));
    CHECK(monitor->evidence().count == 0);
    Noted<Real> noted;
    double force = 0;
    int alarms = 0;
    bool ok = true;
    const int period = 40 * kStride + 1;  // moves on by a phase from one contact to the next
    for (int n = 0; n < 3 * period + 300; ++n) {
      const int since = n - 300 - phase;
      if (since >= 0 && since % period < 30) force += since / period % 2 == 0 ? 20 : -20;
      // A sample is lost shortly before each contact but the first, and two earlier on.
      const int left = period - since % period;
      const bool lost = since > 0 && (left == 9 || left == 600 || left == 601);
      const Quality q = lost ? Quality::missing | Quality::invalid : Quality::good;
      const bool alarmed = monitor->state().state == MonitorState::alarm;
      if (noted.sample > 0 && since >= 0 && since % period == 0)
        ok = ok && replays(*monitor, noted);
      const MonitorState now = monitor->process(static_cast<Real>(force + noise(random)), q);
      if (now != MonitorState::alarm || alarmed) continue;
      ++alarms;
      noted.sample = static_cast<std::uint64_t>(n) + 1;
      noted.jerk = monitor->state().jerk_N_per_s;
      noted.level = monitor->alarm().state().value;
      noted.over = monitor->alarm().state().over_alarm;
      noted.state = monitor->state();
      ok = ok && replays(*monitor, noted);
    }
    ok = ok && replays(*monitor, noted);
    check::that(ok, what.c_str(), __FILE__, __LINE__);
    check::that(alarms == 3, ("three alarms, " + what).c_str(), __FILE__, __LINE__);
  }
}

// The recorder alone, with every small stride, around a block whose value depends on all it has
// seen.
struct Block {
  std::uint64_t hash = 1;
  void take(std::uint32_t x) { hash = (hash ^ x) * 0x100000001b3U; }
};

template <std::size_t Stride>
void strides(std::uint32_t phase) {
  const unsigned seed = 40 + static_cast<unsigned>(Stride) + 1000 * phase;
  std::mt19937 random(seed);
  EvidenceRecorder<Block, std::uint32_t, Stride> recorder;
  Block block;
  recorder.reset(phase);
  std::uint64_t hash = 0, sample = 0;
  bool ok = true;
  for (std::uint64_t n = 1; n <= 5000; ++n) {
    const auto x = static_cast<std::uint32_t>(random());
    if (n % 3 != 0) recorder.prepare(block);  // ahead or with the input, all the same
    recorder.before(block, x);
    block.take(x);
    if (random() % 16 == 0) {  // now and then two alarms in one slot, or in neighbours
      recorder.freeze();
      hash = block.hash;
      sample = n;
    }
    const auto e = recorder.evidence();
    Block again = e.before;
    for (std::uint32_t i = 0; i < e.count; ++i) again.take(e.inputs[i]);
    ok = ok && e.sample == sample && recorder.alarm_sample() == sample &&
         (sample == 0 ? e.count == 0 : again.hash == hash) && e.count <= 2 * Stride &&
         e.count >= std::min<std::uint64_t>(sample, Stride + 1);
  }
  const std::string what = "stride " + std::to_string(Stride) + ", phase " + std::to_string(phase) +
                           ", seed " + std::to_string(seed);
  check::that(ok, what.c_str(), __FILE__, __LINE__);
  recorder.reset();
  CHECK(recorder.evidence().count == 0 && recorder.alarm_sample() == 0);
}

}  // namespace

int main() {
  every_phase<float>();
  every_phase<double>();
  strides<1>(0);
  for (const std::uint32_t phase : {0U, 1U}) strides<2>(phase);
  for (const std::uint32_t phase : {0U, 1U, 2U}) strides<3>(phase);
  for (const std::uint32_t phase : {0U, 1U, 10U, 21U, 31U}) strides<32>(phase);
  return check::done();
}
