#include "servosense/identify/reference_windows.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <cstdio>
#include <limits>
#include <map>
#include <utility>

#include "reference_limits.hpp"
#include "servosense/core/units.hpp"
#include "servosense/dsp/power_spectrum.hpp"
#include "servosense/io/drive_columns.hpp"
#include "servosense/io/text.hpp"

namespace servosense {
namespace {

// Conventions.
constexpr double kFaintest = 3e-3;  // of the signal's rms: what is fainter is no part of it
constexpr double kHighestOrder = 64;
constexpr double kStatedError = 0.02;  // of a speed that no column tells
constexpr double kSmear = 0.75;        // lines of a window that an order may be off
constexpr double kNyquistShare = 0.9;  // of half the sample rate: orders up to there
constexpr double kSpeedChange = 0.05;  // of its speed, between the halves of a window
constexpr double kLeastFilled = 0.9;   // of the samples of a window
constexpr std::size_t kMostBands = 8;
constexpr std::size_t kLeastSegment = 16;
constexpr unsigned kToothMultiples = 3;
constexpr unsigned kPlainOrders = 6;  // where the number of teeth is not known

const double kNaN = std::numeric_limits<double>::quiet_NaN();

double relative_log(double amplitude, double scale) {
  const double share = amplitude / scale;
  return 0.5 * std::log(share * share + kFaintest * kFaintest);
}

std::size_t samples_of(const ReferenceLayout& layout) {
  return static_cast<std::size_t>(
      std::max(1.0, std::round(layout.window_s * layout.sample_rate_hz)));
}

/// Of the spectra: half the window or less, so that some are averaged.
std::size_t segment_of(const ReferenceLayout& layout) {
  std::size_t segment = kLeastSegment;
  while (2 * segment <= samples_of(layout) / 2) segment *= 2;
  return segment;
}

/// Highest order that the rate resolves; 0: none.
unsigned highest_order(const ReferenceLayout& layout) {
  if (!(layout.speed_rad_s > 0) ||
      layout.speed_rad_s * layout.window_s < 0.99 * kLeastTurns * kTwoPi)
    return 0;
  const double per_turn = kTwoPi * layout.sample_rate_hz / layout.speed_rad_s;
  const double turns = layout.speed_rad_s * layout.window_s / kTwoPi;
  const double clear = layout.speed_measured ? kHighestOrder : kSmear / (kStatedError * turns);
  return static_cast<unsigned>(
      std::clamp(kNyquistShare * per_turn / 2, 0.0, std::min(clear, kHighestOrder)));
}

/// Weight of a line in the octave around `middle`.
double octave_weight(double hz, double middle, bool highest) {
  if (!(hz > 0)) return 0;
  const double octaves = std::log2(hz / middle);
  if (highest && octaves > 0) return 1;
  return std::max(0.0, 1 - std::abs(octaves));
}

}  // namespace

std::vector<ReferenceFeature> reference_features(const ReferenceLayout& layout) {
  using Kind = ReferenceFeatureKind;
  const unsigned highest = highest_order(layout), teeth = layout.teeth;
  const bool spectrum = samples_of(layout) >= kLeastSegment;
  std::vector<ReferenceFeature> all;
  for (std::size_t s = 0; s < layout.signals.size(); ++s) {
    all.push_back({s, Kind::level, 0});
    all.push_back({s, Kind::swing, 0});
    const auto order = [&](unsigned k) {
      if (k <= highest) all.push_back({s, Kind::order, static_cast<double>(k)});
    };
    if (teeth > 1) {
      order(1);
      if ((teeth > 2 || highest > 2) && highest > 1) all.push_back({s, Kind::between, 0});
      for (unsigned m = 1; m <= kToothMultiples; ++m) order(m * teeth);
    } else {
      for (unsigned k = 1; k <= kPlainOrders; ++k) order(k);
    }
    if (!spectrum) continue;
    const double lowest_hz = 2 * layout.sample_rate_hz / static_cast<double>(segment_of(layout));
    double middle = layout.sample_rate_hz / 2 / std::sqrt(2.0);
    for (std::size_t b = 0; b < kMostBands && middle >= lowest_hz; ++b, middle /= 2)
      all.push_back({s, Kind::band, middle});
  }
  return all;
}

std::string name_of(const ReferenceLayout& layout, const ReferenceFeature& feature) {
  const std::string name = column_name(layout.signals[feature.signal].signal);
  switch (feature.kind) {
    case ReferenceFeatureKind::level:
      return name + " level";
    case ReferenceFeatureKind::swing:
      return name + " swing";
    case ReferenceFeatureKind::order:
      return name + " order " + number_text(feature.at);
    case ReferenceFeatureKind::between:
      return name + " orders between";
    case ReferenceFeatureKind::band: {
      char middle[32];
      std::snprintf(middle, sizeof middle, " band %.4g Hz", feature.at);
      return name + middle;
    }
  }
  return name;
}

ReferenceCutter::ReferenceCutter(ReferenceLayout layout, const std::vector<Signal>& columns,
                                 TurnColumn turn)
    : layout_(std::move(layout)), features_(reference_features(layout_)), turns_(turn) {
  const auto find = [&](Signal signal) -> std::optional<std::size_t> {
    const auto at = std::find(columns.begin(), columns.end(), signal);
    if (at == columns.end()) return std::nullopt;
    return static_cast<std::size_t>(at - columns.begin());
  };
  for (const ReferenceSignal& s : layout_.signals) column_.push_back(find(s.signal));
  for (const Signal s : layout_.place) place_.push_back(find(s));
  if (layout_.blocks) block_column_ = find({Channel::machine, Quantity::nc_block});
  held_.assign(columns.size(), kNaN);
  bad_now_.assign(columns.size(), true);
  samples_.resize(column_.size());
  places_.resize(place_.size());
  bad_.assign(column_.size(), 0);
}

void ReferenceCutter::hold(const TraceRow& row) {
  for (std::size_t i = 0; i < std::min(held_.size(), row.fields.size()); ++i) {
    const TraceField& f = row.fields[i];
    if (f.state == TraceField::State::empty) continue;
    bad_now_[i] = f.state == TraceField::State::invalid || !std::isfinite(f.value);
    if (!bad_now_[i]) held_[i] = f.value;
  }
}

double TurnCounter::add(const TraceRow& row, std::span<const double> held, double passed_s) {
  if (!turn_.column) return turn_.constant_rad_s * passed_s;
  const std::size_t i = *turn_.column;
  if (turn_.is_speed) return std::isfinite(held[i]) ? held[i] * turn_.rad_per_unit * passed_s : 0;
  if (i >= row.fields.size() || row.fields[i].state != TraceField::State::value) return 0;
  double moved = 0;
  if (turn_.is_counts) {
    const std::int64_t counts = row.fields[i].counts;
    if (last_) moved = static_cast<double>(counts - last_counts_) * turn_.rad_per_unit;
    last_counts_ = counts;
  } else if (last_) {
    moved = (row.fields[i].value - *last_) * turn_.rad_per_unit;
    // An angle of 0 to 2 pi begins anew.
    if (std::abs(moved) > kPi) moved = std::remainder(moved, kTwoPi);
  }
  last_ = row.fields[i].value;
  return moved;
}

std::vector<ReferenceWindow> ReferenceCutter::add(const TraceRow& row) {
  std::vector<ReferenceWindow> done;
  const double t_s = seconds_from(row.t_ns);
  if (!started_) first_s_ = from_s_ = last_s_ = t_s;
  const double tolerance_s = 0.5 / layout_.sample_rate_hz;
  const auto index =
      static_cast<std::int64_t>(std::floor((t_s - first_s_ + tolerance_s) / layout_.window_s));
  if (started_ && index != index_) {
    const auto begin = [&](std::int64_t i) {
      return first_s_ + static_cast<double>(i) * layout_.window_s;
    };
    cut(begin(index_ + 1), false, done);
    if (index > index_ + 1) cut(begin(index), true, done);
    index_ = index;
  }
  hold(row);
  angle_now_ += turns_.add(row, held_, started_ ? t_s - last_s_ : 0);
  started_ = true;
  last_s_ = t_s;
  angle_.push_back(angle_now_);
  for (std::size_t s = 0; s < column_.size(); ++s) {
    if (!column_[s]) continue;
    samples_[s].push_back(held_[*column_[s]]);
    if (bad_now_[*column_[s]]) ++bad_[s];
  }
  for (std::size_t p = 0; p < place_.size(); ++p)
    if (place_[p] && std::isfinite(held_[*place_[p]])) places_[p].push_back(held_[*place_[p]]);
  if (block_column_ && std::isfinite(held_[*block_column_]))
    block_.push_back(static_cast<std::int32_t>(
        std::clamp(std::round(held_[*block_column_]), -1.0, 2147483647.0)));
  return done;
}

std::vector<ReferenceWindow> ReferenceCutter::finish() {
  std::vector<ReferenceWindow> done;
  if (started_ && last_s_ > from_s_) cut(last_s_, false, done);
  if (waiting_) done.push_back(*std::move(waiting_));
  waiting_.reset();
  return done;
}

void ReferenceCutter::cut(double to_s, bool hole, std::vector<ReferenceWindow>& done) {
  ReferenceWindow w;
  w.from_s = from_s_;
  w.to_s = to_s;
  from_s_ = to_s;
  if (hole)
    w.why = NotCompared::too_few_samples;
  else
    describe(w);
  for (std::size_t s = 0; s < samples_.size(); ++s) {
    samples_[s].clear();
    bad_[s] = 0;
  }
  for (auto& p : places_) p.clear();
  angle_.clear();
  block_.clear();
  const bool known = w.why != NotCompared::too_few_samples;
  const bool air = known && w.load < layout_.cutting_level;
  if (air) w.why = NotCompared::not_cutting;
  const auto border = [](ReferenceWindow& cutting) {
    if (cutting.why == NotCompared::no) cutting.why = NotCompared::entry_or_exit;
  };
  if (air_before_) border(w);
  if (air && waiting_) border(*waiting_);
  air_before_ = air;
  if (waiting_) done.push_back(*std::move(waiting_));
  waiting_ = std::move(w);
}

void ReferenceCutter::describe(ReferenceWindow& w) const {
  w.values.assign(features_.size(), kNaN);
  w.place.assign(places_.size(), kNaN);
  const std::size_t n = angle_.size();
  const auto expected = static_cast<double>(samples_of(layout_));
  if (static_cast<double>(n) < kLeastFilled * expected) {
    w.why = NotCompared::too_few_samples;
    return;
  }
  const double count = static_cast<double>(n);
  for (std::size_t p = 0; p < places_.size(); ++p) {
    if (places_[p].empty()) continue;
    double sum = 0;
    for (const double x : places_[p]) sum += x;
    w.place[p] = sum / static_cast<double>(places_[p].size());
  }
  if (!block_.empty()) {  // the one that it is in for longest
    std::map<std::int32_t, std::size_t> rows;
    for (const std::int32_t b : block_) ++rows[b];
    w.block = std::max_element(rows.begin(), rows.end(), [](const auto& a, const auto& b) {
                return a.second < b.second;
              })->first;
  }
  const unsigned highest = highest_order(layout_);
  if (layout_.speed_rad_s > 0 && n > 2) {
    const double first = angle_[n / 2] - angle_[0], second = angle_[n - 1] - angle_[n / 2];
    const double period_s = 1 / layout_.sample_rate_hz;
    w.speed_rad_s = std::abs(first + second) / (count - 1) / period_s;
    const std::size_t middle = n / 2;
    const double half = static_cast<double>(middle) * period_s;
    const double rest = (count - 1) * period_s - half;
    if (w.speed_rad_s < kTurning * layout_.speed_rad_s ||
        std::abs(std::abs(first) / half - std::abs(second) / rest) > kSpeedChange * w.speed_rad_s)
      w.why = NotCompared::other_speed;
  }
  std::vector<double> hann(n);
  double hann_sum = 0;
  for (std::size_t i = 0; i < n; ++i)
    hann_sum += hann[i] = 0.5 - 0.5 * std::cos(kTwoPi * (static_cast<double>(i) + 0.5) / count);
  std::vector<std::complex<double>> turn(highest > 0 ? n : 0);
  for (std::size_t i = 0; i < turn.size(); ++i) turn[i] = std::polar(1.0, angle_[i]);

  std::size_t f = 0;
  for (std::size_t s = 0; s < samples_.size(); ++s) {
    const std::size_t begin = f;
    while (f < features_.size() && features_[f].signal == s) ++f;
    if (!column_[s]) continue;
    const auto& x = samples_[s];
    if (static_cast<double>(bad_[s]) > (1 - kLeastFilled) * count || !std::isfinite(x.front())) {
      if (s == layout_.effort) w.why = NotCompared::too_few_samples;
      continue;
    }
    double mean = 0, magnitude = 0, square = 0;
    for (const double v : x) {
      mean += v / count;
      magnitude += std::abs(v) / count;
    }
    if (s == layout_.effort) w.load = magnitude;
    std::vector<double> rest(n);
    for (std::size_t i = 0; i < n; ++i) {
      rest[i] = x[i] - mean;
      square += rest[i] * rest[i] / count;
    }
    std::vector<double> amplitude(highest + 1);
    std::vector<std::complex<double>> phasor(turn.size(), 1.0);
    for (unsigned k = 1; k <= highest; ++k) {
      std::complex<double> sum = 0;
      for (std::size_t i = 0; i < n; ++i) {
        phasor[i] *= turn[i];
        sum += hann[i] * rest[i] * std::conj(phasor[i]);
      }
      sum *= 2 / hann_sum;
      amplitude[k] = std::abs(sum);
      if (!layout_.speed_measured) continue;
      for (std::size_t i = 0; i < n; ++i) rest[i] -= (sum * phasor[i]).real();
    }
    std::vector<double> hz, power;
    const double scale = layout_.signals[s].scale;
    for (std::size_t j = begin; j < f; ++j) {
      const ReferenceFeature& feature = features_[j];
      double& value = w.values[j];
      switch (feature.kind) {
        case ReferenceFeatureKind::level:
          value = mean / scale;
          break;
        case ReferenceFeatureKind::swing:
          value = relative_log(std::sqrt(square), scale);
          break;
        case ReferenceFeatureKind::order:
          value = relative_log(amplitude[static_cast<std::size_t>(feature.at)], scale);
          break;
        case ReferenceFeatureKind::between: {
          double sum = 0;
          for (unsigned k = 2; k <= std::min(highest, 2 * layout_.teeth - 1); ++k)
            if (k % layout_.teeth != 0) sum += amplitude[k] * amplitude[k];
          value = relative_log(std::sqrt(sum), scale);
          break;
        }
        case ReferenceFeatureKind::band: {
          if (hz.empty()) {
            PowerSpectrum spectrum(segment_of(layout_), layout_.sample_rate_hz);
            for (const double v : rest) spectrum.add(v);
            hz = spectrum.frequency_hz();
            power = spectrum.power();
          }
          const bool top = j == begin || features_[j - 1].kind != ReferenceFeatureKind::band;
          double sum = 0;
          for (std::size_t k = 1; k < hz.size(); ++k)
            sum += power[k] * octave_weight(hz[k], feature.at, top);
          value = relative_log(std::sqrt(sum), scale);
          break;
        }
      }
    }
  }
}

}  // namespace servosense
