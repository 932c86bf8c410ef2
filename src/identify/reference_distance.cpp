#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <set>
#include <utility>

#include "dsp/dense.hpp"
#include "servosense/dsp/quantile.hpp"
#include "servosense/identify/alarm_rate.hpp"
#include "servosense/identify/reference.hpp"

namespace servosense {
namespace {

using Vector = Eigen::VectorXd;
using Matrix = Eigen::MatrixXd;

// Conventions.
constexpr std::size_t kNeighbours = 5;
constexpr double kUnlike = 3;    // standard deviations of a feature: more is not more unlike
constexpr double kPlace = 0.05;  // of the range of a position: as unlike as all features by one
constexpr std::size_t kMostGroups = 16;  // records held out one by one; more are held out together
constexpr std::size_t kParts = 6;        // of a single record: it is dealt out in turn...
constexpr std::size_t kPart = 3;         // ...by so many windows, as many as a distance takes
constexpr std::size_t kLargest = 4;
constexpr double kShare = 0.05;          // as in identify torque-band: what a day does not show
constexpr double kAmplitudeShare = 0.1;  // likewise, of a single order or band
constexpr double kSameSpeed = 0.1;       // part by which alike speeds may differ
constexpr double kLeastShrinkage = 0.05;
constexpr double kEnough = 3;  // records that show as much as is assumed
constexpr int kRounds = 2;
constexpr double kPrior = 4;       // windows of the usual distance
constexpr double kMargin = 1.5;    // as in identify idle: over what is heard, and over usual
constexpr double kFewRecords = 1;  // over usual, shared among the records: they may differ by more

struct Rows {
  std::vector<const ReferenceWindow*> window;
  std::vector<std::size_t> group;
  Matrix values;  // a row each, of the features that are used
  std::size_t groups = 0;
};

/// The kNeighbours sound windows that are most alike, those of `leave_out` aside; empty where there
/// are none of its block and speed. `range` of the places, `scale` of the features.
std::vector<std::size_t> like(const Rows& rows, bool blocks, const std::vector<double>& range,
                              const Vector& scale, const ReferenceWindow& w, const Vector& values,
                              std::size_t leave_out) {
  std::vector<std::pair<double, std::size_t>> found;
  for (std::size_t i = 0; i < rows.window.size(); ++i) {
    if (rows.group[i] == leave_out) continue;
    const ReferenceWindow& s = *rows.window[i];
    if (blocks && w.block >= 0 && s.block != w.block) continue;
    if (s.speed_rad_s > 0 && w.speed_rad_s > 0 &&
        std::abs(std::log(w.speed_rad_s / s.speed_rad_s)) > kSameSpeed)
      continue;
    double apart = (rows.values.row(static_cast<Eigen::Index>(i)).transpose() - values)
                       .cwiseQuotient(scale)
                       .cwiseAbs()
                       .cwiseMin(kUnlike)
                       .squaredNorm() /
                   static_cast<double>(values.size());
    for (std::size_t p = 0; p < range.size(); ++p) {
      const double d = (s.place[p] - w.place[p]) / (kPlace * range[p]);
      if (range[p] > 0 && std::isfinite(d)) apart += d * d;
    }
    found.emplace_back(apart, i);
  }
  if (found.size() > kNeighbours) {
    std::nth_element(found.begin(), found.begin() + kNeighbours, found.end());
    found.resize(kNeighbours);
  }
  std::vector<std::size_t> out;
  for (const auto& [apart, i] : found) out.push_back(i);
  return out;
}

Vector mean_of(const Rows& rows, const std::vector<std::size_t>& which) {
  Vector mean = Vector::Zero(rows.values.cols());
  for (const std::size_t i : which) mean += rows.values.row(static_cast<Eigen::Index>(i));
  return mean / static_cast<double>(which.size());
}

struct Whitening {
  Matrix w;       // z = w r
  Vector spread;  // of each feature
};

/// Root of the mean of the kLargest greatest squares.
double distance_of(const Vector& z) {
  std::vector<double> squares(static_cast<std::size_t>(z.size()));
  for (Eigen::Index i = 0; i < z.size(); ++i) squares[static_cast<std::size_t>(i)] = z[i] * z[i];
  const std::size_t k = std::min(kLargest, squares.size());
  std::partial_sort(squares.begin(), squares.begin() + static_cast<std::ptrdiff_t>(k),
                    squares.end(), std::greater<>());
  double sum = 0;
  for (std::size_t i = 0; i < k; ++i) sum += squares[i];
  return std::sqrt(sum / static_cast<double>(k));
}

/// That distance of `p` standard normal numbers, about: of their quantiles.
double distance_by_chance(std::size_t p) {
  // Upper quantile of |z|, by bisection.
  const auto quantile = [](double beyond) {
    double low = 0, high = 10;
    for (int i = 0; i < 50; ++i) {
      const double middle = (low + high) / 2;
      (std::erfc(middle / std::sqrt(2.0)) > beyond ? low : high) = middle;
    }
    return low;
  };
  const std::size_t k = std::min(kLargest, p);
  double sum = 0;
  for (std::size_t i = 0; i < k; ++i) {
    const double z = quantile((static_cast<double>(i) + 0.5) / static_cast<double>(p));
    sum += z * z;
  }
  return std::sqrt(sum / static_cast<double>(k));
}

/// What no few records show. `each`: spread of every feature by itself; `together`: how all move
/// when all amplitudes grow.
struct Unseen {
  Vector each, together;
};

/// From differences, a row each: z = W r.
Matrix whitening_once(const Matrix& r, const Unseen& unseen) {
  const Eigen::Index n = r.rows(), p = r.cols();
  const Vector spread =
      (r.colwise().squaredNorm().transpose() / static_cast<double>(n)).cwiseSqrt().cwiseMax(1e-12);
  const Matrix z = r * spread.cwiseInverse().asDiagonal();
  Matrix corr = z.transpose() * z / static_cast<double>(n);
  // How uncertain the correlations are against how large (Schaefer, Strimmer 2005, eq. 10).
  const Matrix z2 = z.cwiseAbs2();
  const Matrix second = z2.transpose() * z2 / static_cast<double>(n);
  double uncertain = 0, large = 0;
  for (Eigen::Index i = 0; i < p; ++i)
    for (Eigen::Index j = 0; j < p; ++j) {
      if (i == j) continue;
      uncertain += (second(i, j) - corr(i, j) * corr(i, j)) / static_cast<double>(n - 1);
      large += corr(i, j) * corr(i, j);
    }
  const double lambda = large > 0 ? std::clamp(uncertain / large, kLeastShrinkage, 1.0) : 1;
  corr *= 1 - lambda;
  corr.diagonal().setOnes();
  Matrix s = spread.asDiagonal() * corr * spread.asDiagonal();
  s.diagonal() += unseen.each.cwiseAbs2();
  s += unseen.together * unseen.together.transpose();
  const Vector inverse = s.diagonal().cwiseSqrt().cwiseInverse();
  const dense::SymmetricEigen eigen =
      dense::symmetric_eigen(inverse.asDiagonal() * s * inverse.asDiagonal());
  const Vector root = eigen.values.cwiseMax(1e-6).cwiseSqrt().cwiseInverse();
  return eigen.vectors * root.asDiagonal() * eigen.vectors.transpose() * inverse.asDiagonal();
}

/// The same, windows that are farther than the middle one drawn in to it: entries, corners and
/// reversals must not be the measure of all others (Tyler 1987).
Matrix whitening_of(const Matrix& r, const Unseen& unseen) {
  Matrix w = whitening_once(r, unseen);
  for (int round = 0; round < kRounds; ++round) {
    std::vector<double> d;
    for (Eigen::Index i = 0; i < r.rows(); ++i) d.push_back(distance_of(w * r.row(i).transpose()));
    const double middle = median(d);
    Matrix drawn = r;
    for (Eigen::Index i = 0; i < r.rows(); ++i)
      if (d[static_cast<std::size_t>(i)] > middle)
        drawn.row(i) *= middle / d[static_cast<std::size_t>(i)];
    w = whitening_once(drawn, unseen);
  }
  return w;
}

}  // namespace

std::vector<double> ThreeInARow::add(double distance) {
  last_[2] = last_[1];
  last_[1] = last_[0];
  last_[0] = distance;
  count_ = std::min<std::size_t>(count_ + 1, 3);
  if (count_ < 3) return {};
  const double middle =
      std::max(std::min(last_[0], last_[1]), std::min(std::max(last_[0], last_[1]), last_[2]));
  const bool first = !told_;
  told_ = true;
  return first ? std::vector<double>(3, middle) : std::vector<double>{middle};
}

struct ReferenceDistance::Content {
  bool blocks = false;
  std::vector<ReferenceFeature> features;
  std::vector<std::size_t> used;  // of them
  std::vector<SoundWindow> sound;
  Rows rows;
  std::vector<double> range;  // of the places
  Vector scale;               // of the features
  Matrix whitening;
  std::vector<double> apart;  // of each sound window from its like in other records; NaN: none
  double chance = 0;          // as far as numbers of their spread are apart by chance
  double usual = 0;           // the middle one, or that
  std::vector<double> held_out;
  double threshold = 0, extrapolated = 0;

  /// How far the sound windows among `which` are from their own like.
  [[nodiscard]] double local(const std::vector<std::size_t>& which) const {
    double sum = kPrior * usual * usual, count = kPrior;
    for (const std::size_t i : which) {
      if (!std::isfinite(apart[i])) continue;
      sum += std::max(apart[i] * apart[i], chance * chance);
      count += 1;
    }
    return std::sqrt(sum / count);
  }
  std::vector<double> amplitude;  // of each feature in use, the sound one; 0 for a level

  /// As they are compared: of an amplitude that is fainter than the sound one the logarithm says
  /// much and means little.
  [[nodiscard]] Vector compressed(Vector v) const {
    for (std::size_t j = 0; j < amplitude.size(); ++j) {
      double& x = v[static_cast<Eigen::Index>(j)];
      if (amplitude[j] > 0) x = std::log(std::exp(x) + amplitude[j]);
    }
    return v;
  }
  /// Difference of compressed values. A band that is quieter than in sound cuts is no damage.
  [[nodiscard]] Vector difference(const Vector& values, const Vector& like) const {
    Vector r = values - like;
    for (std::size_t j = 0; j < used.size(); ++j)
      if (features[used[j]].kind == ReferenceFeatureKind::band)
        r[static_cast<Eigen::Index>(j)] = std::max(0.0, r[static_cast<Eigen::Index>(j)]);
    return r;
  }
  [[nodiscard]] std::optional<Vector> values_of(const ReferenceWindow& w) const {
    Vector v(static_cast<Eigen::Index>(used.size()));
    for (std::size_t j = 0; j < used.size(); ++j) {
      if (used[j] >= w.values.size() || !std::isfinite(w.values[used[j]])) return std::nullopt;
      v[static_cast<Eigen::Index>(j)] = w.values[used[j]];
    }
    return v;
  }
};

ReferenceDistance::ReferenceDistance(std::unique_ptr<Content> content)
    : content_(std::move(content)) {}
ReferenceDistance::ReferenceDistance(ReferenceDistance&&) noexcept = default;
ReferenceDistance& ReferenceDistance::operator=(ReferenceDistance&&) noexcept = default;
ReferenceDistance::~ReferenceDistance() = default;

Expected<ReferenceDistance> ReferenceDistance::learn(const Reference& reference,
                                                     const std::vector<bool>& present) {
  auto content = std::make_unique<Content>();
  Content& c = *content;
  c.blocks = reference.layout.blocks;
  c.features = reference_features(reference.layout);
  for (std::size_t j = 0; j < c.features.size(); ++j)
    if (c.features[j].signal < present.size() && present[c.features[j].signal]) c.used.push_back(j);
  if (c.used.empty())
    return data_error("the record has none of the signals that the reference was learned from");
  c.sound = reference.sound;
  std::erase_if(c.sound, [&](const SoundWindow& s) { return !c.values_of(s.window); });
  const std::size_t n = c.sound.size();
  if (n < kLeastWindows)
    return data_error("there are " + std::to_string(n) + " windows of sound cuts, and it takes " +
                      std::to_string(kLeastWindows) +
                      " to tell a sound cut from another; record more, or give a shorter window");
  // Records held out together, or parts of the only one.
  std::set<std::size_t> records;
  for (const SoundWindow& s : c.sound) records.insert(s.trace);
  c.rows.groups = records.size() > 1 ? std::min(records.size(), kMostGroups) : kParts;
  c.rows.values.resize(static_cast<Eigen::Index>(n), static_cast<Eigen::Index>(c.used.size()));
  for (std::size_t i = 0; i < n; ++i) {
    c.rows.window.push_back(&c.sound[i].window);
    const auto record =
        static_cast<std::size_t>(std::distance(records.begin(), records.find(c.sound[i].trace)));
    c.rows.group.push_back(records.size() > 1 ? record % c.rows.groups : i / kPart % kParts);
    c.rows.values.row(static_cast<Eigen::Index>(i)) = *c.values_of(c.sound[i].window);
  }
  for (std::size_t j = 0; j < c.used.size(); ++j)
    c.amplitude.push_back(c.features[c.used[j]].kind == ReferenceFeatureKind::level
                              ? 0
                              : std::exp(c.rows.values.col(static_cast<Eigen::Index>(j)).mean()));
  for (Eigen::Index i = 0; i < c.rows.values.rows(); ++i)
    c.rows.values.row(i) = c.compressed(c.rows.values.row(i).transpose()).transpose();
  for (std::size_t p = 0; p < reference.layout.place.size(); ++p) {
    double low = std::numeric_limits<double>::infinity(), high = -low;
    for (const SoundWindow& s : c.sound) {
      low = std::min(low, s.window.place[p]);
      high = std::max(high, s.window.place[p]);
    }
    c.range.push_back(high > low ? high - low : 0);
  }
  const Vector centre = c.rows.values.colwise().mean();
  c.scale = ((c.rows.values.rowwise() - centre.transpose()).colwise().squaredNorm().transpose() /
             static_cast<double>(n))
                .cwiseSqrt()
                .cwiseMax(kShare);
  // The more records there are, the more of it they show themselves.
  const double left = 1 / std::sqrt(1 + (static_cast<double>(records.size()) - 1) / kEnough);
  Unseen unseen{Vector(centre.size()), Vector(centre.size())};
  for (std::size_t j = 0; j < c.used.size(); ++j) {
    const auto at = static_cast<Eigen::Index>(j);
    const bool level = c.features[c.used[j]].kind == ReferenceFeatureKind::level;
    // A compressed logarithm moves by half.
    unseen.each[at] = left * (level ? kShare : kAmplitudeShare / 2);
    unseen.together[at] = left * kShare * (level ? centre[at] : 0.5);
  }
  // Differences of each window from its like in the other records.
  std::vector<std::size_t> kept;
  std::vector<std::vector<std::size_t>> others_of;
  Matrix r(static_cast<Eigen::Index>(n), centre.size());
  for (std::size_t i = 0; i < n; ++i) {
    const Vector values = c.rows.values.row(static_cast<Eigen::Index>(i)).transpose();
    auto others =
        like(c.rows, c.blocks, c.range, c.scale, *c.rows.window[i], values, c.rows.group[i]);
    if (others.empty()) continue;
    r.row(static_cast<Eigen::Index>(kept.size())) =
        c.difference(values, mean_of(c.rows, others)).transpose();
    kept.push_back(i);
    others_of.push_back(std::move(others));
  }
  r.conservativeResize(static_cast<Eigen::Index>(kept.size()), Eigen::NoChange);
  // Distances of the windows of a group as the others would have them.
  c.apart.assign(n, std::numeric_limits<double>::quiet_NaN());
  std::vector<double> all;
  for (std::size_t g = 0; g < c.rows.groups; ++g) {
    Matrix rest(r.rows(), r.cols());
    Eigen::Index rows = 0;
    for (std::size_t k = 0; k < kept.size(); ++k)
      if (c.rows.group[kept[k]] != g) rest.row(rows++) = r.row(static_cast<Eigen::Index>(k));
    rest.conservativeResize(rows, Eigen::NoChange);
    if (static_cast<std::size_t>(rows) < kLeastWindows / 2) continue;
    const Matrix w = whitening_of(rest, unseen);
    for (std::size_t k = 0; k < kept.size(); ++k)
      if (c.rows.group[kept[k]] == g)
        all.push_back(c.apart[kept[k]] =
                          distance_of(w * r.row(static_cast<Eigen::Index>(k)).transpose()));
  }
  if (all.size() >= kLeastWindows) {
    c.chance = distance_by_chance(c.used.size());
    c.usual = std::max(median(all), c.chance);
    std::vector<ThreeInARow> three(c.rows.groups);
    std::vector<const SoundWindow*> before(c.rows.groups, nullptr);
    for (std::size_t k = 0; k < kept.size(); ++k) {
      const std::size_t i = kept[k], g = c.rows.group[i];
      if (!std::isfinite(c.apart[i])) continue;
      const SoundWindow& s = c.sound[i];
      if (before[g] == nullptr || before[g]->trace != s.trace ||
          std::abs(before[g]->window.to_s - s.window.from_s) > 1e-6 * reference.layout.window_s)
        three[g].interrupt();
      before[g] = &s;
      for (const double held : three[g].add(c.apart[i] / c.local(others_of[k])))
        c.held_out.push_back(held);
    }
  }
  if (c.held_out.size() < kLeastWindows)
    return data_error("of the windows of sound cuts " + std::to_string(c.held_out.size()) +
                      " have their like in another record and neighbours in time, and it takes " +
                      std::to_string(kLeastWindows) +
                      "; record the section more often, or give a shorter window");
  c.whitening = whitening_of(r, unseen);
  // Shares in place of rates: the run has so many "hours" as windows.
  const PeakTail tail(c.held_out, 4, static_cast<double>(c.held_out.size()));
  const double highest = *std::max_element(c.held_out.begin(), c.held_out.end());
  c.threshold = std::max(std::clamp(tail.level(reference.false_alarms), highest, kMargin * highest),
                         kMargin + kFewRecords / static_cast<double>(records.size()));
  c.extrapolated = tail.per_hour(c.threshold);
  return ReferenceDistance(std::move(content));
}

std::optional<Compared> ReferenceDistance::compare(const ReferenceWindow& window) const {
  const Content& c = *content_;
  const auto plain = c.values_of(window);
  if (!plain) return std::nullopt;
  const Vector values = c.compressed(*plain);
  const auto others = like(c.rows, c.blocks, c.range, c.scale, window, values, c.rows.groups);
  if (others.empty()) return std::nullopt;
  const Vector sound = mean_of(c.rows, others);
  const Vector r = c.difference(values, sound);
  const Vector z = c.whitening * r;
  Compared out;
  out.distance = distance_of(z) / c.local(others);
  Eigen::Index most = 0;
  z.cwiseAbs().maxCoeff(&most);
  out.feature = c.used[static_cast<std::size_t>(most)];
  const double amplitude = c.amplitude[static_cast<std::size_t>(most)];
  out.ratio = amplitude > 0 ? std::exp((*plain)[most]) /
                                  std::max(std::exp(sound[most]) - amplitude, 0.1 * amplitude)
                            : values[most] / sound[most];
  return out;
}

double ReferenceDistance::threshold() const { return content_->threshold; }
const std::vector<double>& ReferenceDistance::held_out() const { return content_->held_out; }
double ReferenceDistance::extrapolated_rate() const { return content_->extrapolated; }
double ReferenceDistance::supported_rate() const {
  return 1 / (static_cast<double>(content_->held_out.size()) + 1);
}

double ReferenceDistance::seen_ratio() const {
  const Content& c = *content_;
  std::vector<double> ratios;
  for (std::size_t j = 0; j < c.used.size(); ++j) {
    if (c.features[c.used[j]].kind == ReferenceFeatureKind::level) continue;
    const double each = distance_of(c.whitening.col(static_cast<Eigen::Index>(j)));
    if (each > 0) ratios.push_back(2 * std::exp(c.threshold * c.usual / each) - 1);
  }
  if (ratios.empty()) return std::numeric_limits<double>::quiet_NaN();
  const auto middle = ratios.begin() + static_cast<std::ptrdiff_t>(ratios.size() / 2);
  std::nth_element(ratios.begin(), middle, ratios.end());
  return *middle;
}

}  // namespace servosense
