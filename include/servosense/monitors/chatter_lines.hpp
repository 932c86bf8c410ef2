// A narrow line in what a torque changes by from revolution to revolution: chatter in noise.
//
// Purpose: hears chatter that the noise of a counter hides from a power over the whole band. That
// noise grows with the square of the frequency, a line stands in a few hertz of it.
// Equation: r_n, the change of the mean torque over a part of the revolution since the last
// revolution (revolution_comb.hpp), over the last L parts, Hann window, P_k its power on line k,
// order o = k N / L with N parts a revolution:
//   score_k = P_k / noise_k,  an alarm where the largest exceeds the threshold
//   noise_k = (A S(f) + B R(f)) 4 sin^2(pi o)      what noise gives, so that its mean is one
// S is the noise of a counter through the observer (Koike 2016, eq. 2-23, Tustin), R that of the
// effort, both through the mean over a part and with the image beyond half the rate of the parts
// (observer/estimate_noise.hpp has them in full). A and B follow the noise itself, by one
// multiplicative step of the maximum of likelihood a transform (Fevotte, Bertin and Durrieu 2009,
// eq. 13: Itakura-Saito divergence), in which a line counts for five at most. Of white noise score
// is exponential, so a threshold follows from a rate of false alarms (chatter_line_threshold).
// What is no chatter is left out by what is known of it:
//   rotation   lines within 0.8 of a harmonic; lines weaker than what lies at the two harmonics
//              beside them, or than that at the two tooth harmonics beside them over the square of
//              the distance in orders: a cut that changes
//   counter    the sawtooth of its rounding has lines at the counts a sample, times 1 to 8, and
//              those whole orders away: a score counts beyond the largest that such a line can
//              have, elsewhere that of the ninth. Rounding has q^2 / 12 in all: what A finds
//              between the lines is in none of them
//   load       lines below a share of the load (chatter_verdict.hpp)
//   steps      lines that are no peak, and lines less than six times what lies beside them
// Of a sensor (Noise::sensor) no law of the noise is known: a score is what stands over the mean of
// the eight lines beside it (cell averaging, Finn and Johnson 1968), whatever the unit; there is
// no counter, and lines of the machine itself are left out.
// Discretisation: L = 512 parts, begun anew every 128: 0.15 s in 0.04 s at 2.4 samples a part.
// Delay: half the window, and 0.03 s for the transform.
// Cost on Cortex-M4F: 340 instructions a sample in the mean, 840 at most, in slices.
// Range: |torque| < 1e12 Nm.
// Numerical bound: that of the transform; A and B are kept above 1e-12 and below 1e12 of a
// counter's rounding. Bad at: chatter within 0.8 lines of a harmonic of the rotation; slow
// spindles, where a window is few revolutions (1200 rpm: four) and only what lies halfway between
// harmonics is heard; counter lines beyond 20 bits in single precision, which do not lie where they
// are expected, but are weak.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <type_traits>

#include "servosense/core/real_time.hpp"
#include "servosense/core/units.hpp"
#include "servosense/dsp/sliced_fourier.hpp"
#include "servosense/monitors/chatter_config.hpp"

namespace servosense {

/// The strongest line of a transform.
template <RealNumber Real>
struct ChatterLineFound {
  Real score = 0;         ///< of noise: exponential, mean one; 0: none stands out
  Real frequency_hz = 0;  ///< of the torque
  Real error_hz = 0;      ///< its standard error
  Real power_Nm2 = 0;     ///< mean square
};

template <RealNumber Real, ChatterNoise Noise = ChatterNoise::drive>
class ChatterLines {
 public:
  static constexpr bool kOfSensor = Noise == ChatterNoise::sensor;
  /// Transforms in a row that raise an alarm. What noise rings in a sensor is narrow, but has no
  /// phase of its own: five transforms are two windows, and it would have to be as loud in both.
  static constexpr unsigned kConsecutive = kOfSensor ? 5 : 1;
  static constexpr std::size_t kOwnLines = kOfSensor ? 8 : 0;
  static constexpr std::uint32_t kParts = 512;  ///< L
  static constexpr std::uint32_t kHop = 128;
  static constexpr std::uint32_t kHalf = kParts / 2;
  using Found = ChatterLineFound<Real>;

  struct State {
    Found found;                   ///< of the last transform; nothing after a restart
    std::uint64_t transforms = 0;  ///< so far
    Real counter = 1;              ///< A, in powers of the counter's rounding
    Real effort = kEffortAtFirst;  ///< B, likewise
    Real samples = 0;              ///< of the window
    std::uint32_t parts = 0;       ///< a revolution
    std::uint32_t heard = 0;       ///< parts in the window, up to L
  };

  /// Requires a valid ChatterConfig; off without a threshold for lines, and without their noise.
  void configure(const ChatterConfig& c) noexcept {
    const ChatterLinesConfig& l = c.lines;
    on_ = l.threshold > 0 && (kOfSensor || l.inertia_kg_m2 > 0);
    threshold_ = static_cast<Real>(l.threshold);
    share_ = static_cast<Real>(c.tolerated_load_share);
    counts_ = static_cast<Real>(l.counts_per_turn);
    teeth_ = c.teeth > 0 ? c.teeth : 1;
    period_s_ = static_cast<Real>(c.sample_period_s);
    const auto pole = [&](double cutoff_rad_s) {  // of a first-order low-pass, Tustin
      const double gT = cutoff_rad_s * c.sample_period_s;
      return gT / (2 + gT);
    };
    const double g = pole(l.disturbance_cutoff_rad_s), h = pole(l.velocity_cutoff_rad_s);
    g_[0] = static_cast<Real>(4 * g * g);
    g_[1] = static_cast<Real>(4 * (1 - 2 * g));
    h_[0] = static_cast<Real>(4 * h * h);
    h_[1] = static_cast<Real>(4 * (1 - 2 * h));
    // Mean of P for white noise of the parts is 3/8 L; a part is samples / L long, and its noise is
    // that of one sample over its length.
    const double rounding =
        l.inertia_kg_m2 * kTwoPi / (l.counts_per_turn > 0 ? l.counts_per_turn : kUsualCounts);
    const double T = c.sample_period_s;
    gain_ = static_cast<Real>(16 * g * g * h * h * rounding * rounding / 12 / (T * T * T * T) *
                              0.375 * kParts * kParts);
    if constexpr (kOfSensor) {
      counts_ = 0;
      gain_ = static_cast<Real>(0.375 * kParts * kParts);
    }
    reset();
  }
  void reset() noexcept {
    state_ = State{};
    fourier_.reset();
    stage_ = Stage::wait;
    next_ = fresh_ = samples_ = 0;
    begun_ = false;
  }
  [[nodiscard]] bool on() const noexcept { return on_; }
  void set_own_lines(std::span<const double> own_hz) noexcept requires kOfSensor {
    own_hz_ = {};
    for (std::size_t i = 0; i < kOwnLines && i < own_hz.size(); ++i)
      own_hz_[i] = static_cast<Real>(own_hz[i]);
  }
  /// What has been heard does not count: a cut that begins, steps or is fed unevenly.
  void restart() noexcept {
    state_.heard = 0;
    begun_ = false;
    state_.found = Found{};
    stage_ = Stage::wait;
  }
  /// Another number of parts a revolution.
  void start(std::uint32_t parts) noexcept {
    restart();
    state_.parts = parts;
  }
  /// A part has changed by so much since the last revolution [Nm]; it ended so many samples ago.
  void take(Real change_Nm, Real ago) noexcept {
    State& s = state_;
    if (!begun_) {  // the window is counted from the end of this part
      begun_ = true;
      fresh_ = 0;
      return mark(ago);
    }
    ring_[next_] = change_Nm;
    next_ = (next_ + 1) & (kParts - 1);
    if (s.heard < kParts) ++s.heard;
    if (++fresh_ < kHop) return;
    fresh_ = 0;
    mark(ago);
    if (s.heard < kParts || stage_ != Stage::wait) return;
    s.samples = between(kMarks - 1, 0);
    middle_ = Real(2) * between(3 * (kMarks - 1) / 4, (kMarks - 1) / 4);
    stage_ = Stage::transform;
    oldest_ = next_;
    fourier_.begin();
  }
  /// A slice, with every sample. `load_Nm2`: mean square of the torque, the largest remembered.
  void step(Real load_Nm2) noexcept {
    ++samples_;
    switch (stage_) {
      case Stage::wait:
        return;
      case Stage::transform:
        if (fourier_.step([&](std::uint32_t n) { return ring_[(oldest_ + n) & (kParts - 1)]; }))
          prepare();
        return;
      case Stage::whiten:
        for (std::uint32_t i = 0; i < kWhitened && next_line_ < kHalf; ++i) whiten(next_line_++);
        if (next_line_ == kHalf) follow();
        return;
      case Stage::seek:
        seek(load_Nm2);
        return;
    }
  }
  [[nodiscard]] const State& state() const noexcept { return state_; }

 private:
  enum class Stage : unsigned char { wait, transform, whiten, seek };
  using Table = CosineTable<Real, kParts>;
  static constexpr double kUsualCounts = 131072;  // where A and B begin, nothing else
  static constexpr Real kEffortAtFirst = Real(0.01);
  // Lines beside a harmonic that are its own: half of one, by which the strongest may stand off it,
  // and three standard errors of a frequency at the usual threshold.
  static constexpr Real kMask = Real(0.8);
  static constexpr Real kCounter = Real(2.5);  // lines beside one of the counter's
  static constexpr Real kAllOfIt = Real(1.1);  // power of rounding, a tenth for what A is off by
  static constexpr Real kMost = 5;             // what a line counts for when noise is followed
  static constexpr Real kBeside = 6;           // of what lies beside a line
  static constexpr Real kTooth = 2;            // of tooth harmonics, at a distance of one order
  static constexpr Real kFaintest = 8;         // score that is looked at
  static constexpr std::uint32_t kEachSide = kOfSensor ? 4 : 8;  // of a line, what lies beside
  static constexpr Real kOwn = 2;                              // lines beside one of the machine's
  static constexpr Real kSlowest_hz = 60;                      // below, the controller answers
  static constexpr std::uint32_t kWhitened = 3, kSought = 16;  // lines a slice
  static constexpr std::uint32_t kMarks = kParts / kHop + 1;
  static constexpr std::uint32_t kCounterLines = 8;
  struct Mark {
    std::uint32_t sample = 0;
    Real ago = 0;
  };

  [[nodiscard]] static Real magnitude(Real x) noexcept { return x < 0 ? -x : x; }
  [[nodiscard]] static Real to_whole(Real x) noexcept {  // distance to the nearest
    const Real d = x - static_cast<Real>(static_cast<std::int32_t>(x));
    return d > Real(0.5) ? Real(1) - d : d < Real(-0.5) ? Real(1) + d : magnitude(d);
  }
  void mark(Real ago) noexcept {
    for (std::uint32_t i = kMarks - 1; i > 0; --i) marks_[i] = marks_[i - 1];
    marks_[0] = {samples_, ago};
  }

  // Samples from one mark to a later one.
  [[nodiscard]] Real between(std::uint32_t from, std::uint32_t to) const noexcept {
    return static_cast<Real>(marks_[to].sample - marks_[from].sample) -
           (marks_[to].ago - marks_[from].ago);
  }
  // Where lines of the counter lie while a window of parts takes so many samples, in orders.
  void expect_counter(Real samples, std::uint32_t at) noexcept {
    const Real turn = samples * static_cast<Real>(state_.parts) / kLength;
    const Real counts = counts_ / turn;  // a sample
    for (std::uint32_t k = 0; k < kCounterLines; ++k) {
      const Real n = static_cast<Real>(k + 1) * counts;
      counter_order_[at + k] =
          (n - static_cast<Real>(static_cast<std::int32_t>(n + Real(0.5)))) * turn;
    }
  }
  // Constants of this transform.
  void prepare() noexcept {
    const State& s = state_;
    // Half the angle that line 1 turns by in a sample, its double as a rotation; that of the image.
    const Real step = static_cast<Real>(kTwoPi) / s.samples;
    turn_ = sine_cosine(step);
    line_ = {0, 1};
    rate_hz_ = static_cast<Real>(kParts) / (s.samples * period_s_);  // of the parts
    const Real image = static_cast<Real>(kParts) / s.samples;        // of the sample rate
    image_ = sine_cosine(static_cast<Real>(kTwoPi) * image);
    // Power of a mean over a part: the noise of its samples, per hertz, times its rate.
    scale_ = gain_ / s.samples;
    lowest_ = kSlowest_hz / rate_hz_ * static_cast<Real>(kParts);
    expect_counter(s.samples, 0);
    // A speed that begins to change moves the mean away from where the line stands.
    expect_counter(middle_, kCounterLines);
    expected_ = to_whole(counter_order_[0] - counter_order_[kCounterLines]) >
                        kCounter * static_cast<Real>(s.parts) / kLength
                    ? 2 * kCounterLines
                    : kCounterLines;
    up_counter_ = down_counter_ = up_effort_ = down_effort_ = 0;
    next_line_ = 1;
    stage_ = Stage::whiten;
  }
  // Noise of the estimate at a frequency whose sample turns by 2 x: counter and effort.
  struct Densities {
    Real counter, effort;
  };
  [[nodiscard]] Densities noise(Real cosine_2x) const noexcept {
    if constexpr (kOfSensor) return {Real(0), Real(1)};
    const Real sine = Real(0.5) - Real(0.5) * cosine_2x;  // squared
    const Real cosine = Real(1) - sine;
    const Real low = Real(1) / ((g_[0] + g_[1] * sine) * (h_[0] + h_[1] * sine));
    return {Real(16) * sine * sine * low, cosine * cosine * low};
  }
  void whiten(std::uint32_t k) noexcept {
    State& s = state_;
    line_ = {line_.sine * turn_.cosine + line_.cosine * turn_.sine,
             line_.cosine * turn_.cosine - line_.sine * turn_.sine};
    const std::uint32_t place = (k * s.parts) & (kParts - 1);  // of the order, within a whole one
    const std::uint32_t beside = place < kHalf ? place : kParts - place;
    score_[k] = kMasked;
    const auto line = static_cast<Real>(k);
    if (static_cast<Real>(beside) < kMask * static_cast<Real>(s.parts) || line < lowest_) return;
    if constexpr (kOfSensor)
      if (of_the_machine(line)) return;
    const Densities here = noise(line_.cosine);
    const Densities image = noise(image_.cosine * line_.cosine + image_.sine * line_.sine);
    // Squared sine of pi k / L over that of its argument: the mean over a part.
    const Real mean = (Real(0.5) - Real(0.5) * Table::cosine(k)) * kOverPi2 * kParts2;
    const Real a = mean / (line * line), b = mean / ((kLength - line) * (kLength - line));
    const Real comb = Real(2) - Real(2) * Table::cosine(place);
    const Real counter = (a * here.counter + b * image.counter) * scale_ * comb;
    const Real effort = (a * here.effort + b * image.effort) * scale_ * comb;
    const Real one = Real(1) / (s.counter * counter + s.effort * effort);
    const Real score = fourier_.power(k) * one;
    if (!(score < kLargest)) return;
    score_[k] = score;
    const Real counts = score < kMost ? score : kMost;
    up_counter_ += counts * counter * one;
    down_counter_ += counter * one;
    up_effort_ += counts * effort * one;
    down_effort_ += effort * one;
  }
  void follow() noexcept {
    State& s = state_;
    const auto followed = [](Real level, Real up, Real down) {
      const Real next = down > 0 ? level * up / down : level;
      return next < kLeast ? kLeast : next < 1 / kLeast ? next : 1 / kLeast;
    };
    s.counter = followed(s.counter, up_counter_, down_counter_);
    s.effort = followed(s.effort, up_effort_, down_effort_);
    best_ = Found{};
    best_.score = kFaintest;
    next_line_ = 2;
    stage_ = Stage::seek;
  }
  // A line of the machine itself lies here, or where the rate of the parts folds it to.
  [[nodiscard]] bool of_the_machine(Real line) const noexcept requires kOfSensor {
    for (const Real hz : own_hz_) {
      const Real own = hz / rate_hz_ * kLength;
      if (hz > 0 && (magnitude(line - own) < kOwn || magnitude(kLength - own - line) < kOwn))
        return true;
    }
    return false;
  }
  // Power on the line at an order, or the next above.
  [[nodiscard]] Real at_order(std::uint32_t order) const noexcept {
    const std::uint32_t k = order * kParts / state_.parts;
    if (k + 1 >= kHalf) return Real(0);
    const Real a = fourier_.power(k), b = fourier_.power(k + 1);
    return a > b ? a : b;
  }
  // What lies beside a line, from the third on.
  [[nodiscard]] Real beside(std::uint32_t k) const noexcept {
    Real sum = 0;
    std::uint32_t count = 0;
    for (std::uint32_t e = 3, got = 0; e < 24 && got < kEachSide; ++e)
      if (k > e && score_[k - e] >= 0) sum += score_[k - e], ++count, ++got;
    for (std::uint32_t e = 3, got = 0; e < 24 && got < kEachSide; ++e)
      if (k + e < kHalf && score_[k + e] >= 0) sum += score_[k + e], ++count, ++got;
    return count > 0 ? sum / static_cast<Real>(count) : Real(0);
  }
  [[nodiscard]] bool of_a_changing_cut(std::uint32_t k) const noexcept {
    const Real power = fourier_.power(k);
    const std::uint32_t parts = state_.parts;
    const std::uint32_t order = k * parts / kParts;
    if (power < at_order(order) || power < at_order(order + 1)) return true;
    const Real here = static_cast<Real>(k * parts) / kLength;
    const std::uint32_t tooth = order - order % teeth_;
    const Real under = here - static_cast<Real>(tooth);
    const Real over = static_cast<Real>(tooth + teeth_) - here;
    return power * under * under < kTooth * at_order(tooth) ||
           power * over * over < kTooth * at_order(tooth + teeth_);
  }
  // Largest score of a line of the counter at this one.
  [[nodiscard]] Real of_the_counter(std::uint32_t k) const noexcept {
    if (!(counts_ > 0)) return Real(0);
    const Real here = static_cast<Real>((k * state_.parts) & (kParts - 1)) / kLength;
    const Real near = kCounter * static_cast<Real>(state_.parts) / kLength;
    // Those beyond are everywhere.
    Real most = Real(1) / ((kCounterLines + 1) * (kCounterLines + 1));
    for (std::uint32_t n = 0; n < expected_; ++n) {
      const Real order = counter_order_[n];
      if (to_whole(here - order) > near && to_whole(here + order) > near) continue;
      const auto times = static_cast<Real>(n % kCounterLines + 1);
      const Real share = Real(1) / (times * times);
      if (share > most) most = share;
    }
    // Rounding has so much power in all, and what lies between the lines is in none of them.
    const Real left = kAllOfIt - state_.counter;
    if (!(left > 0)) return Real(0);
    return Real(2) * kOverPi2 * state_.samples * most * left / state_.counter;
  }
  void seek(Real load_Nm2) noexcept {
    State& s = state_;
    for (std::uint32_t i = 0; i < kSought; ++i) {
      const std::uint32_t k = next_line_++;
      if (k + 1 >= kHalf) return tell();
      const Real power = fourier_.power(k), least = kOfSensor ? Real(0) : best_.score;
      Real score = score_[k];
      if (!(score > least) || power < fourier_.power(k - 1) || power < fourier_.power(k + 1))
        continue;
      if constexpr (kOfSensor) {
        const Real floor = beside(k);
        score = floor > 0 ? score / floor : Real(0);
        if (!(score > best_.score)) return;  // enough for a slice
      }
      const std::uint32_t place = (k * s.parts) & (kParts - 1);
      const Real comb = Real(2) - Real(2) * Table::cosine(place);
      const Real power_Nm2 = Real(8) * power / (kParts2 * comb);
      if (power_Nm2 < share_ * load_Nm2) continue;
      if constexpr (!kOfSensor)
        if (score < kBeside * beside(k)) return;  // enough for a slice
      if (of_a_changing_cut(k)) return;
      const Real counter = of_the_counter(k);
      if (counter > 0 && score < counter + threshold_) return;
      best_.score = score;
      best_.power_Nm2 = power_Nm2;
      best_line_ = k;
      return;
    }
  }
  void tell() noexcept {
    State& s = state_;
    if (best_.score > kFaintest) {
      const std::uint32_t k = best_line_;
      // Between lines of a Hann window (Grandke 1983, eq. 9).
      const Real line_hz = rate_hz_ / kLength;
      const bool above = fourier_.power(k + 1) > fourier_.power(k - 1);
      const Real ratio =
          std::sqrt((above ? fourier_.power(k + 1) : fourier_.power(k - 1)) / fourier_.power(k));
      Real between = (Real(2) * ratio - Real(1)) / (ratio + Real(1));
      if (between < 0) between = 0;
      best_.frequency_hz = (static_cast<Real>(k) + (above ? between : -between)) * line_hz;
      best_.error_hz = kError * line_hz / std::sqrt(best_.score);
    }
    s.found = best_.score > kFaintest ? best_ : Found{};
    ++s.transforms;
    stage_ = Stage::wait;
  }

  static constexpr Real kLength = static_cast<Real>(kParts);
  static constexpr Real kParts2 = kLength * kLength;
  static constexpr Real kOverPi2 = static_cast<Real>(1 / (kPi * kPi));
  static constexpr Real kMasked = -1;
  static constexpr Real kLargest = Real(1e30);
  static constexpr Real kLeast = Real(1e-12);
  static constexpr Real kError = Real(0.6);  // lines, at a score of one

  State state_;
  SlicedFourier<Real, kParts> fourier_;
  std::array<Real, kParts> ring_{};
  std::array<Real, kHalf> score_{};
  std::array<Mark, kMarks> marks_{};
  std::array<Real, std::size_t{kCounterLines} * 2> counter_order_{};
  Real g_[2]{}, h_[2]{};
  struct None {};
  [[no_unique_address]] std::conditional_t<kOfSensor, std::array<Real, kOwnLines>, None> own_hz_{};
  SineCosine<Real> turn_{0, 1}, line_{0, 1}, image_{0, 1};
  Found best_;
  Real gain_ = 0, scale_ = 0, rate_hz_ = 0, lowest_ = 0, period_s_ = 0;
  Real threshold_ = 0, share_ = 0, counts_ = 0, middle_ = 0;
  Real up_counter_ = 0, down_counter_ = 0, up_effort_ = 0, down_effort_ = 0;
  std::uint32_t teeth_ = 1, next_ = 0, oldest_ = 0, fresh_ = 0, next_line_ = 0, best_line_ = 0;
  std::uint32_t samples_ = 0, expected_ = 0;
  Stage stage_ = Stage::wait;
  bool on_ = false;
  bool begun_ = false;
};

}  // namespace servosense
