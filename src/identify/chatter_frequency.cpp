#include "servosense/identify/chatter_frequency.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <optional>

#include "dsp/fourier.hpp"
#include "servosense/core/units.hpp"

namespace servosense {
namespace {

constexpr std::size_t kFewest = 256;
constexpr double kFewestTurns = 8;
constexpr double kHighestTooth_hz = 12000;  // harmonics of the teeth beyond carry nothing
constexpr double kStandsOut = 20;           // 13 dB: noise reaches it in one stretch of 500
constexpr double kMember = 6;               // of a comb that stands out, found where it must be
constexpr double kLeastGain = 0.1;          // of the observer, where lines are looked for...
constexpr double kLeastMember = 0.03;       // ...and members of a comb
constexpr double kAtHarmonic = 1.5;         // resolutions
/// Of a tooth frequency. There regeneration all but vanishes (1 - exp(-j w T) -> 0): what vibrates
/// is forced, and changes.
constexpr double kNextToTeeth = 0.06;
constexpr double kLeastComb = 0.1;  // of all that stands out, for the first of overtones
constexpr int kOvertones = 4;
constexpr double kOfLines = 0.5;   // of all lines that stand out
constexpr double kOfRest = 0.3;    // of what does not repeat
constexpr double kOffMean = 0.2;   // of a tooth frequency, from the mean to its line
constexpr double kNearMode = 0.1;  // of a natural frequency
constexpr double kEdge = 0.05;     // of the strongest, where the comb leaves the band

/// Least squares on columns of unit length by conjugate gradients (Hestenes & Stiefel 1952): nearly
/// orthogonal, and rank does not matter.
class ShapeColumns {
 public:
  explicit ShapeColumns(std::size_t rows) : rows_(rows) {}
  [[nodiscard]] std::size_t count() const { return columns_.size(); }
  void add(std::vector<double> column) {
    double square = 0;
    for (const double v : column) square += v * v;
    if (!(square > 1e-12 * static_cast<double>(rows_))) return;
    const double scale = 1 / std::sqrt(square);
    for (double& v : column) v *= scale;
    columns_.push_back(std::move(column));
  }
  /// What the columns leave of `y`.
  [[nodiscard]] std::vector<double> rest(std::span<const double> y) const {
    std::vector<double> r(y.begin(), y.end()), s = project(r), p = s, q(rows_);
    double now = dot(s, s);
    const double least = 1e-10 * now;
    for (int i = 0; i < 60 && now > least; ++i) {
      std::fill(q.begin(), q.end(), 0.0);
      for (std::size_t j = 0; j < columns_.size(); ++j)
        for (std::size_t k = 0; k < rows_; ++k) q[k] += p[j] * columns_[j][k];
      const double square = dot(q, q);
      if (!(square > 0)) break;
      for (std::size_t k = 0; k < rows_; ++k) r[k] -= now / square * q[k];
      s = project(r);
      const double next = dot(s, s);
      for (std::size_t j = 0; j < p.size(); ++j) p[j] = s[j] + next / now * p[j];
      now = next;
    }
    return r;
  }

 private:
  static double dot(const std::vector<double>& a, const std::vector<double>& b) {
    double sum = 0;
    for (std::size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
    return sum;
  }
  [[nodiscard]] std::vector<double> project(const std::vector<double>& r) const {
    std::vector<double> s;
    s.reserve(columns_.size());
    for (const auto& column : columns_) s.push_back(dot(column, r));
    return s;
  }
  std::size_t rows_;
  std::vector<std::vector<double>> columns_;
};

/// What does not repeat with the spindle.
std::vector<double> without_harmonics(std::span<const double> torque, std::span<const double> angle,
                                      std::span<const char> renewed, const ChatterLineConfig& c,
                                      double rotation_hz) {
  const std::size_t n = torque.size();
  const auto make = [&](auto&& value) {
    std::vector<double> column(n);
    for (std::size_t i = 0; i < n; ++i) column[i] = value(i);
    return column;
  };
  ShapeColumns columns(n);
  columns.add(make([](std::size_t) { return 1.0; }));
  columns.add(
      make([&](std::size_t i) { return static_cast<double>(i) - static_cast<double>(n) / 2; }));
  const std::size_t room = n / 3;  // the rest must keep its lines
  const auto harmonic = [&](int h) {
    if (columns.count() + 2 > room) return;
    columns.add(make([&](std::size_t i) { return std::cos(h * angle[i]); }));
    columns.add(make([&](std::size_t i) { return std::sin(h * angle[i]); }));
  };
  const int below = static_cast<int>(0.5 / c.sample_period_s / rotation_hz);
  for (int h = 1; h <= below; ++h) harmonic(h);
  if (std::any_of(renewed.begin(), renewed.end(), [](char fresh) { return fresh == 0; })) {
    const double share = c.disturbance_cutoff_rad_s > 0
                             ? 1 - std::exp(-c.disturbance_cutoff_rad_s * c.sample_period_s)
                             : 1;
    for (int h = 1; h <= below && columns.count() + 2 <= room; ++h)
      for (const double shift : {0.0, kPi / 2}) {
        double held = std::cos(h * angle[0] - shift), lagged = held;
        columns.add(make([&](std::size_t i) {
          if (renewed[i] != 0) held = std::cos(h * angle[i] - shift);
          return lagged += share * (held - lagged);
        }));
      }
  }
  if (c.teeth > 0) {
    const int z = static_cast<int>(c.teeth);
    for (int h = (below / z + 1) * z; h * rotation_hz < kHighestTooth_hz; h += z) harmonic(h);
  }
  return columns.rest(torque);
}

std::vector<double> counted_on(std::span<const double> angle) {
  std::vector<double> on(angle.begin(), angle.end());
  for (std::size_t i = 1; i < on.size(); ++i)
    on[i] = on[i - 1] + std::remainder(angle[i] - angle[i - 1], kTwoPi);
  return on;
}

/// Power over frequency of what is left, with the noise about each place.
class Spectrum {
 public:
  Spectrum(const std::vector<double>& rest, const ChatterLineConfig& c)
      : config_(c), samples_(static_cast<double>(rest.size())) {
    std::size_t size = 1;
    while (size < 4 * rest.size()) size *= 2;
    std::vector<double> tapered(size, 0.0);
    for (std::size_t i = 0; i < rest.size(); ++i)
      tapered[i] =
          rest[i] * (0.5 - 0.5 * std::cos(kTwoPi * (static_cast<double>(i) + 0.5) / samples_));
    const std::vector<std::complex<double>> lines = fourier_lines(tapered);
    step_hz_ = 1 / (static_cast<double>(size) * c.sample_period_s);
    cell_hz_ = 1 / (samples_ * c.sample_period_s);
    power_.resize(size / 2);
    for (std::size_t k = 0; k < power_.size(); ++k) power_[k] = std::norm(lines[k]);
    find_noise();
  }
  [[nodiscard]] double cell_hz() const { return cell_hz_; }
  [[nodiscard]] double gain(double hz) const {
    double gain = 1;
    for (const double cutoff : {config_.disturbance_cutoff_rad_s, config_.velocity_cutoff_rad_s})
      if (cutoff > 0) gain /= std::hypot(1, kTwoPi * hz / cutoff);
    return gain;
  }
  /// Below half the rate and where the observer lets so much through.
  [[nodiscard]] double highest_hz(double least_gain) const {
    double hz = 0.475 / config_.sample_period_s;
    while (hz > 0 && gain(hz) < least_gain) hz -= cell_hz_;
    return hz;
  }
  /// Squared amplitude before the observer of a comb's member; 0 where none can be told.
  [[nodiscard]] double member(double hz) const {
    const double place = std::abs(hz);
    const std::size_t from = at(place - 0.7 * cell_hz_), to = at(place + 0.7 * cell_hz_);
    if (to >= power_.size()) return 0;
    double most = 0;
    for (std::size_t k = from; k <= to; ++k) most = std::max(most, power_[k]);
    const double noise = noise_[at(place)];
    return most < kMember * noise ? 0 : squared((most - noise), place);
  }

  struct Peak {
    double hz = 0, square_Nm2 = 0, heard_Nm2 = 0, over_noise = 0;
  };
  /// What stands out, strongest before the observer first.
  [[nodiscard]] std::vector<Peak> peaks(double from_hz, double to_hz) const {
    std::vector<Peak> found;
    for (std::size_t k = std::max<std::size_t>(2, at(from_hz)); k < at(to_hz); ++k) {
      if (!(power_[k] >= power_[k - 1] && power_[k] >= power_[k + 1])) continue;
      if (power_[k] < kStandsOut * noise_[k]) continue;
      const double a = std::log(power_[k - 1]), b = std::log(power_[k]),
                   c = std::log(power_[k + 1]);
      const double bend = a - 2 * b + c;
      const double hz = (static_cast<double>(k) + (bend < 0 ? 0.5 * (a - c) / bend : 0)) * step_hz_;
      found.push_back({hz, squared(power_[k], hz), squared(power_[k], 0), power_[k] / noise_[k]});
    }
    std::sort(found.begin(), found.end(),
              [](const Peak& a, const Peak& b) { return a.square_Nm2 > b.square_Nm2; });
    return found;
  }

 private:
  [[nodiscard]] std::size_t at(double hz) const {
    return hz > 0 ? static_cast<std::size_t>(std::llround(hz / step_hz_)) : 0;
  }
  [[nodiscard]] double squared(double power, double hz) const {
    const double amplitude = 4 * std::sqrt(power) / samples_ / gain(hz);
    return amplitude * amplitude;
  }
  void find_noise() {
    const auto half = static_cast<std::size_t>(32 * cell_hz_ / step_hz_);
    noise_.resize(power_.size());
    std::vector<double> about;
    for (std::size_t k = 0; k < power_.size(); k += 8) {
      about.clear();
      const std::size_t last = std::min(power_.size() - 1, k + half);
      for (std::size_t i = k > half ? k - half : 0; i <= last; i += 3) about.push_back(power_[i]);
      const auto middle = about.begin() + static_cast<std::ptrdiff_t>(about.size() / 2);
      std::nth_element(about.begin(), middle, about.end());
      // Power of noise is distributed exponentially.
      const double mean = *middle / std::log(2.0);
      for (std::size_t i = k; i < std::min(power_.size(), k + 8); ++i) noise_[i] = mean;
    }
  }

  ChatterLineConfig config_;
  double samples_, step_hz_ = 0, cell_hz_ = 0;
  std::vector<double> power_, noise_;
};

double off_whole(double x) { return std::abs(x - std::round(x)); }

/// Lines a tooth frequency apart, `part` of it above its harmonics, or as much below.
struct Comb {
  double part = 0;
  Spectrum::Peak strongest;
  double square_Nm2 = 0, heard_Nm2 = 0;
};

std::vector<Comb> combs_of(const std::vector<Spectrum::Peak>& peaks, double tooth_hz,
                           double tolerance) {
  std::vector<Comb> combs;
  for (const auto& p : peaks) {
    const double part = p.hz / tooth_hz - std::floor(p.hz / tooth_hz);
    auto known = std::find_if(combs.begin(), combs.end(), [&](const Comb& q) {
      return off_whole(q.part - part) < tolerance || off_whole(q.part + part) < tolerance;
    });
    if (known == combs.end()) known = combs.insert(combs.end(), {part, p, 0, 0});
    known->square_Nm2 += p.square_Nm2;
    known->heard_Nm2 += p.heard_Nm2;
  }
  return combs;
}

/// The first of overtones.
const Comb* first_of(const std::vector<Comb>& combs, double total, double tolerance) {
  const Comb* first = nullptr;
  double most = 0;
  for (const Comb& c : combs) {
    if (c.square_Nm2 < kLeastComb * total) continue;
    double explained = c.square_Nm2;
    for (const Comb& other : combs) {
      bool is = false;
      for (int h = 2; h <= kOvertones && &other != &c; ++h)
        is = is || off_whole(h * c.part - other.part) < tolerance ||
             off_whole(h * c.part + other.part) < tolerance;
      if (is) explained += other.square_Nm2;
    }
    if (explained > most) most = explained, first = &c;
  }
  return most < kOfLines * total ? nullptr : first;
}

/// Mean place of the comb's power, in tooth frequencies from `hz`; nothing when it goes on beyond
/// the band.
std::optional<double> mean_of_comb(const Spectrum& spectrum, double hz, double tooth_hz,
                                   double least_hz) {
  const double highest_hz = spectrum.highest_hz(kLeastMember);
  // Half a wave left between two teeth: lines from below zero fall on those above.
  const double part = hz / tooth_hz - std::floor(hz / tooth_hz);
  const bool folded = std::abs(part - 0.5) * tooth_hz < 2 * spectrum.cell_hz();
  double sum = 0, moment = 0, most = 0;
  bool beyond = false;
  for (const int way : {1, -1}) {
    int missed = 0;
    double last = 0;
    for (int k = way > 0 ? 0 : -1; missed < 2; k += way) {
      const double place = hz + k * tooth_hz;
      if (folded && place < 0) break;
      if (std::abs(place) > highest_hz) {
        beyond = beyond || last > kEdge * most;
        break;
      }
      const double square = std::abs(place) < least_hz ? 0 : spectrum.member(place);
      if (square > 0) {
        sum += square;
        moment += k * square;
        most = std::max(most, square);
        last = square;
        missed = 0;
      } else if (std::abs(place) > least_hz) {
        ++missed;
      }
    }
  }
  if (beyond || !(sum > 0)) return std::nullopt;
  return moment / sum;
}

/// How far a frequency is from where the nearest known mode chatters, a little above its natural
/// frequency; as a part of that.
double off_modes(const std::vector<double>& natural_hz, double hz) {
  double nearest = 1;
  for (const double natural : natural_hz)
    nearest = std::min(nearest, std::abs(hz / natural - 1.02));
  return nearest;
}

}  // namespace

ChatterLine chatter_line(std::span<const double> torque_Nm, std::span<const double> angle_rad,
                         std::span<const char> renewed, const ChatterLineConfig& config) {
  ChatterLine line;
  const std::size_t n = torque_Nm.size();
  if (n < kFewest || n != angle_rad.size() || (!renewed.empty() && n != renewed.size()))
    return line;
  for (std::size_t i = 0; i < n; ++i)
    if (!std::isfinite(torque_Nm[i]) || !std::isfinite(angle_rad[i])) return line;
  const std::vector<double> angle = counted_on(angle_rad);
  const double turns = std::abs(angle.back() - angle.front()) / kTwoPi;
  if (turns * static_cast<double>(n) / static_cast<double>(n - 1) < 0.99 * kFewestTurns)
    return line;
  const double rotation_hz = turns / (static_cast<double>(n - 1) * config.sample_period_s);
  line.spindle_speed_rpm = 60 * rotation_hz;
  const double tooth_hz = rotation_hz * (config.teeth > 0 ? config.teeth : 1);

  const std::vector<double> rest =
      without_harmonics(torque_Nm, angle, renewed, config, rotation_hz);
  double power = 0;
  for (const double v : rest) power += v * v / static_cast<double>(n);
  const Spectrum spectrum(rest, config);
  const double cell = spectrum.cell_hz();
  const double least_hz = std::max(4 * cell, 0.5 * rotation_hz);
  const auto peaks = spectrum.peaks(least_hz, spectrum.highest_hz(kLeastGain));
  if (peaks.empty()) return line;
  const double tolerance = 1.2 * cell / tooth_hz;
  const std::vector<Comb> combs = combs_of(peaks, tooth_hz, tolerance);
  double total = 0;
  for (const Comb& c : combs) total += c.square_Nm2;
  const Comb* comb = first_of(combs, total, tolerance);
  if (comb == nullptr || comb->square_Nm2 < kOfLines * total ||
      comb->heard_Nm2 / 2 < kOfRest * power)
    return line;
  const double hz = comb->strongest.hz;
  line.line_hz = hz;
  line.amplitude_Nm = std::sqrt(comb->strongest.square_Nm2);
  line.standard_error_hz = cell * std::max(0.1, 1 / std::sqrt(comb->strongest.over_noise));
  if (off_whole(hz / rotation_hz) * rotation_hz < kAtHarmonic * cell ||
      (config.teeth > 0 && off_whole(hz / tooth_hz) < kNextToTeeth)) {
    line.verdict = ChatterLineVerdict::forced;
    return line;
  }
  const auto tell = [&](double place) {
    line.verdict = ChatterLineVerdict::told;
    line.frequency_hz = place;
    line.waves_per_tooth = place / tooth_hz;
    line.candidates_hz = {place};
  };
  line.verdict = ChatterLineVerdict::undecided;
  if (config.teeth == 0) return line;
  const auto mean = mean_of_comb(spectrum, hz, tooth_hz, least_hz);
  if (!mean) return line;
  const double place = *mean - 0.5 / config.teeth;
  const double nearest = std::round(place);
  const auto hz_of = [&](double k) { return std::abs(hz + k * tooth_hz); };
  // Where natural frequencies are known, chatter lies near one of them.
  const auto& natural = config.natural_frequencies_hz;
  const auto near_mode = [&](double place_hz) {
    return natural.empty() || off_modes(natural, place_hz) < kNearMode;
  };
  if (config.teeth > 2 && std::abs(place - nearest) < kOffMean) {
    if (near_mode(hz_of(nearest))) tell(hz_of(nearest));
    return line;
  }
  // Between two: a known natural frequency decides that is at least twice as near to one of them.
  std::array<double, 2> pair = {hz_of(std::floor(place)), hz_of(std::ceil(place))};
  line.candidates_hz = {pair[0], pair[1]};
  std::sort(pair.begin(), pair.end(),
            [&](double a, double b) { return off_modes(natural, a) < off_modes(natural, b); });
  if (!natural.empty() && near_mode(pair[0]) &&
      2 * off_modes(natural, pair[0]) < off_modes(natural, pair[1]))
    tell(pair[0]);
  return line;
}

ChatterLine chatter_line_at(double line_hz, double standard_error_hz, double spindle_speed_rpm,
                            const ChatterLineConfig& config) {
  ChatterLine line;
  line.verdict = ChatterLineVerdict::undecided;
  line.line_hz = line_hz;
  line.standard_error_hz = standard_error_hz;
  line.spindle_speed_rpm = spindle_speed_rpm;
  const auto& natural = config.natural_frequencies_hz;
  if (natural.empty() || config.teeth == 0 || !(spindle_speed_rpm > 0)) return line;
  const double tooth_hz = spindle_speed_rpm / 60 * config.teeth;
  const double highest_hz = 2 * *std::max_element(natural.begin(), natural.end());
  double nearest_hz = 0, nearest = 1, next = 1;
  for (double place = -highest_hz + std::fmod(line_hz + highest_hz, tooth_hz); place < highest_hz;
       place += tooth_hz) {
    const double off = off_modes(natural, std::abs(place));
    next = std::min(next, std::max(off, nearest));
    if (off < nearest) nearest = off, nearest_hz = std::abs(place);
  }
  if (nearest > kNearMode || 2 * nearest > next) return line;
  line.verdict = ChatterLineVerdict::told;
  line.frequency_hz = nearest_hz;
  line.waves_per_tooth = nearest_hz / tooth_hz;
  line.candidates_hz = {nearest_hz};
  return line;
}

}  // namespace servosense
