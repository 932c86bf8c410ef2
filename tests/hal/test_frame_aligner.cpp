// Frame aligner: every value a frame carries is the number of the servo period it was made in, so
// that a row shows by itself whether it was put together rightly.
#include <algorithm>
#include <cmath>
#include <map>
#include <random>

#include "check.hpp"
#include "servosense/hal/frame_aligner.hpp"

using namespace servosense;

namespace {

constexpr Nanoseconds kPeriod = 125000;

struct Frame {
  std::size_t stream = 0;
  Nanoseconds t_ns = 0;
  std::int64_t row = 0;  // of the newest sample
  bool sync = false;
};

struct Faults {
  double drop = 0, twice = 0, swap = 0;  // share of the frames
  double jitter_s = 0;                   // uniform delay
  double stall_every_s = 0;              // the bus stands still for stall_s, then all come at once
  double stall_s = 0;
  double drift = 0;  // of the drives' clock
};

struct Injected {
  std::map<std::size_t, std::uint64_t> dropped;
  std::uint64_t drops = 0, duplicates = 0, swaps = 0, frames = 0;
};

// Frames of all streams, in the order of their arrival.
std::vector<Frame> frames_of(const AlignerConfig& config, std::int64_t rows, const Faults& faults,
                             unsigned seed, Injected& injected) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::vector<Frame> frames;
  const double period_ns = static_cast<double>(kPeriod) * (1 + faults.drift);
  for (std::int64_t row = 0; row < rows; ++row) {
    auto arrival = [&](double phase) {
      double t =
          (static_cast<double>(row) + phase) * period_ns + 1e9 * faults.jitter_s * uniform(random);
      if (faults.stall_every_s > 0) {
        const double in = std::fmod(t, 1e9 * faults.stall_every_s);
        if (in < 1e9 * faults.stall_s && t > 1e8) t += 1e9 * faults.stall_s - in;
      }
      return static_cast<Nanoseconds>(t) + 5'000'000'000;
    };
    if (config.sync) frames.push_back({0, arrival(0), row, true});
    for (std::size_t s = 0; s < config.streams.size(); ++s) {
      const AlignerStream& c = config.streams[s];
      if (row % c.every != c.samples - 1) continue;
      const double phase = 0.1 + 0.1 * static_cast<double>(s);
      const bool steady = row > 200 && row < rows - 200;
      if (steady && uniform(random) < faults.drop) {
        ++injected.drops;
        ++injected.dropped[s];
        continue;
      }
      frames.push_back({s, arrival(phase), row, false});
      if (steady && uniform(random) < faults.twice) {
        frames.push_back({s, frames.back().t_ns, row, false});
        ++injected.duplicates;
      }
    }
  }
  std::stable_sort(frames.begin(), frames.end(),
                   [](const Frame& a, const Frame& b) { return a.t_ns < b.t_ns; });
  // Neighbours of one stream change places.
  for (std::size_t i = 4000; i + 4000 < frames.size(); ++i) {
    if (uniform(random) >= faults.swap || frames[i].sync) continue;
    for (std::size_t j = i + 1; j < frames.size(); ++j)
      if (!frames[j].sync && frames[j].stream == frames[i].stream) {
        if (frames[j].row > frames[i].row) {
          std::swap(frames[i].row, frames[j].row);
          ++injected.swaps;
        }
        i = j + 4;
        break;
      }
  }
  injected.frames = frames.size();
  return frames;
}

struct Outcome {
  std::uint64_t rows = 0, right = 0, wrong = 0, invalid = 0, empty = 0;
  std::int64_t greatest_delay = 0;  // rows between the newest frame and the row given out
  std::int64_t allowed_delay = 0;
  bool ordered = true;
};

Outcome run(const AlignerConfig& config, const std::vector<Frame>& frames, AlignerHealth& health) {
  FrameAligner aligner(config);
  Outcome outcome;
  outcome.allowed_delay = aligner.longest_delay_rows();
  TraceRow row;
  std::int64_t first = -1, newest = 0;
  Nanoseconds last_t = -1;
  auto drain = [&](bool end) {
    while (aligner.pop(row)) {
      ++outcome.rows;
      outcome.ordered = outcome.ordered && row.t_ns > last_t;
      last_t = row.t_ns;
      // The first row tells what the aligner calls zero.
      if (first < 0)
        for (const TraceField& f : row.fields)
          if (f.state == TraceField::State::value)
            first = static_cast<std::int64_t>(f.value) - (row.t_ns - 5'000'000'000) / kPeriod;
      const std::int64_t index = std::llround(static_cast<double>(row.t_ns - 5'000'000'000) /
                                              static_cast<double>(kPeriod)) +
                                 first;
      if (!end) outcome.greatest_delay = std::max(outcome.greatest_delay, newest - index);
      for (const TraceField& f : row.fields) {
        if (f.state == TraceField::State::empty)
          ++outcome.empty;
        else if (f.state == TraceField::State::invalid)
          ++outcome.invalid;
        else if (static_cast<std::int64_t>(f.value) == index)
          ++outcome.right;
        else
          ++outcome.wrong;
      }
    }
  };
  std::vector<TraceField> fields;
  for (const Frame& f : frames) {
    if (f.sync) {
      aligner.sync(f.t_ns);
      continue;
    }
    const AlignerStream& c = config.streams[f.stream];
    fields.clear();
    for (unsigned k = 0; k < c.samples; ++k)
      for (std::size_t i = 0; i < c.columns; ++i)
        fields.push_back(TraceField::of(static_cast<double>(f.row - c.samples + 1 + k)));
    std::optional<std::uint32_t> sequence;
    if (c.sequence_bits > 0) {
      const auto n = static_cast<std::uint64_t>(f.row / c.every) + 250;
      sequence = static_cast<std::uint32_t>(n & ((std::uint64_t{1} << c.sequence_bits) - 1));
    }
    newest = std::max(newest, f.row);
    aligner.push(f.stream, f.t_ns, fields, sequence);
    drain(false);
  }
  aligner.finish();
  drain(true);
  health = aligner.health();
  return outcome;
}

AlignerConfig counted() {  // x and y single, spindle in blocks of eight, a slow current
  return {
      kPeriod, {{0, 2, 1, 1, 8}, {2, 1, 1, 1, 8}, {3, 2, 8, 8, 16}, {5, 1, 1, 4, 8}}, false, 20};
}
AlignerConfig uncounted() {
  return {kPeriod, {{0, 2, 1, 1, 0}, {2, 1, 1, 1, 0}, {3, 2, 8, 8, 0}, {5, 1, 1, 4, 0}}, false, 20};
}

void undisturbed() {
  for (const bool counts : {true, false}) {
    const AlignerConfig config = counts ? counted() : uncounted();
    CHECK(FrameAligner::validate(config).ok());
    Injected injected;
    AlignerHealth health;
    const auto outcome = run(config, frames_of(config, 16000, {}, 1, injected), health);
    CHECK(outcome.ordered);
    CHECK(outcome.wrong == 0);
    CHECK(outcome.rows >= 15990);
    CHECK(outcome.invalid <= 40);  // rows at either end for which a block was never sent
    CHECK(health.lost + health.late + health.duplicates + health.reordered + health.restarts <= 8);
  }
}

// Everything at once, with counters: every repair counted equals every fault made.
void counters() {
  for (const unsigned seed : {11U, 12U, 13U}) {
    Faults faults{0.001, 0.001, 0.001, 60e-6, 0.37, 0.002, 300e-6};
    Injected injected;
    AlignerHealth health;
    const AlignerConfig config = counted();
    const auto outcome = run(config, frames_of(config, 160000, faults, seed, injected), health);
    CHECK(outcome.ordered);
    CHECK(outcome.wrong == 0);
    CHECK(health.lost == injected.drops);
    CHECK(health.duplicates == injected.duplicates);
    CHECK(health.reordered == injected.swaps);
    CHECK(health.late == 0 && health.restarts == 0);
    CHECK(injected.drops > 200 && injected.duplicates > 200 && injected.swaps > 200);
    // What is invalid is what was dropped, and nothing else: 2, 1, 16 and 1 values a frame.
    std::uint64_t expected = 0;
    const std::size_t values[] = {2, 1, 16, 1};
    for (const auto& [stream, n] : injected.dropped) expected += n * values[stream];
    CHECK(outcome.invalid >= expected && outcome.invalid <= expected + 40);
    CHECK(outcome.greatest_delay <= outcome.allowed_delay);
  }
}

// Without counters: stalls lose nothing, lost frames are found, at their place.
void without_counters() {
  for (const unsigned seed : {21U, 22U, 23U}) {
    Injected injected;
    AlignerHealth health;
    const AlignerConfig config = uncounted();
    const auto stalls = run(
        config, frames_of(config, 160000, {0, 0, 0, 20e-6, 0.37, 0.002, 300e-6}, seed, injected),
        health);
    CHECK(stalls.wrong == 0);
    CHECK(health.lost <= 4 && health.late == 0 && health.restarts == 0);
    for (const bool twice : {false, true}) {
      Faults faults{0.001, 0, 0, 20e-6, 0, 0, -300e-6};
      if (twice) std::swap(faults.drop, faults.twice);
      Injected second;
      const auto drops = run(config, frames_of(config, 160000, faults, seed, second), health);
      CHECK(drops.wrong == 0);
      CHECK(health.lost == second.drops);
      CHECK(health.duplicates == second.duplicates);
      CHECK(drops.greatest_delay <= drops.allowed_delay);
      CHECK(health.late == 0 && health.restarts == 0);
    }
  }
}

// A SYNC frame opens each period: no counter, no clock needed.
void synchronous() {
  AlignerConfig config{kPeriod, {{0, 2, 1, 1, 0}, {2, 1, 1, 1, 0}}, true, 20};
  Injected injected;
  AlignerHealth health;
  // Jitter stays within the period: the drives answer before the next SYNC.
  const auto outcome =
      run(config, frames_of(config, 80000, {0.001, 0.001, 0, 0, 0.37, 0.002, 1e-3}, 31, injected),
          health);
  CHECK(outcome.wrong == 0);
  CHECK(health.lost == injected.drops);
  CHECK(health.duplicates == injected.duplicates);
}

// A long silence is a hole in time, not thousands of rows; then all goes on.
void holes_and_restarts() {
  for (const bool counts : {true, false}) {
    const AlignerConfig config = counts ? counted() : uncounted();
    Injected injected;
    AlignerHealth health;
    auto frames = frames_of(config, 40000, {}, 41, injected);
    frames.erase(std::remove_if(frames.begin(), frames.end(),
                                [](const Frame& f) { return f.row >= 10000 && f.row < 30000; }),
                 frames.end());
    const auto outcome = run(config, frames, health);
    CHECK(outcome.wrong == 0);
    CHECK(outcome.rows > 19900 && outcome.rows < 20100);
  }
  // One drive falls silent and comes back; the others are not held up by more than the wait.
  for (const bool counts : {true, false}) {
    const AlignerConfig config = counts ? counted() : uncounted();
    Injected injected;
    AlignerHealth health;
    auto frames = frames_of(config, 40000, {}, 42, injected);
    frames.erase(std::remove_if(frames.begin(), frames.end(),
                                [](const Frame& f) {
                                  return f.stream == 1 && f.row >= 10000 && f.row < 30000;
                                }),
                 frames.end());
    const auto outcome = run(config, frames, health);
    CHECK(outcome.wrong == 0);
    CHECK(health.lost >= 19990 && health.lost <= 20010);
    CHECK(outcome.greatest_delay <= outcome.allowed_delay);
  }
  // A drive starts anew and counts from somewhere else: a few frames later it is believed.
  AlignerConfig config{kPeriod, {{0, 1, 1, 1, 8}}, false, 20};
  FrameAligner aligner(config);
  TraceRow row;
  std::uint64_t rows = 0;
  for (int i = 0; i < 2000; ++i) {
    const TraceField field = TraceField::of(i);
    const auto sequence = static_cast<std::uint32_t>((i < 1000 ? i : i - 57) & 255);
    aligner.push(0, i * kPeriod, {&field, 1}, sequence);
    while (aligner.pop(row)) ++rows;
  }
  CHECK(rows >= 1990);
  CHECK(aligner.health().restarts == 1);
}

void refused() {
  CHECK(!FrameAligner::validate({kPeriod, {}, false, 20}).ok());
  CHECK(!FrameAligner::validate({10, {{0, 1, 1, 1, 0}}, false, 20}).ok());
  CHECK(!FrameAligner::validate({kPeriod, {{0, 1, 8, 4, 0}}, false, 20}).ok());
  CHECK(!FrameAligner::validate({kPeriod, {{0, 1, 1, 1, 33}}, false, 20}).ok());
  CHECK(!FrameAligner::validate({kPeriod, {{0, 1, 1, 1, 0}}, false, 0}).ok());
}

}  // namespace

int main() {
  undisturbed();
  counters();
  without_counters();
  synchronous();
  holes_and_restarts();
  refused();
  return check::done();
}
