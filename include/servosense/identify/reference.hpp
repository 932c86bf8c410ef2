// What sound cuts of one tool and program section look like, and how far a window is from them.
//
// A window is held against the sound windows of its like: those of its block, and of them the
// kNeighbours nearest in the positions of the axes (all where the record has neither). The
// difference r to their mean is made comparable by what sound windows differ by from those of other
// records, S, and the distance is
//   d = sqrt(mean of the kLargest greatest z^2),   z = P^-1/2 V^-1/2 r,   S = V^1/2 P V^1/2
// (Kessy, Lewin, Strimmer 2018: of all whitenings the one whose z still belong to the features).
// The greatest alone count: damage moves a few features, and a mean over all of them would bury it.
// Of three windows of a cut in a row the middle distance is taken: one that stands alone is noise.
//   S: second moments of r, each record held out in turn (of a single record its parts); the
//      correlations shrunk towards zero (Schaefer, Strimmer 2005); and what days, stock and edges
//      bring that a few records do not show: kShare of every amplitude and of all of them together.
//   threshold: distances of the held-out sound windows, their tail extrapolated to the accepted
//      rate by the predictive law of PeakTail (identify/alarm_rate.hpp).
// Bad at: sound cuts that the records do not stand for; damage that was there while it was learned.
#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/identify/reference_windows.hpp"
#include "servosense/io/line_reader.hpp"

namespace servosense {

/// A window of a sound cut.
struct SoundWindow {
  std::size_t trace = 0;  ///< of Reference::traces
  ReferenceWindow window;
};

struct Reference {
  ReferenceLayout layout;
  std::string machine;         ///< its name
  double tool_diameter_m = 0;  ///< 0 = not known
  double false_alarms = 1e-3;  ///< accepted share of sound windows
  std::vector<std::string> traces;
  std::vector<SoundWindow> sound;  ///< in the order of the traces and of time
};

/// A window beside the sound ones.
struct Compared {
  double distance = 0;
  std::size_t feature = 0;  ///< of reference_features(): the one that has moved most
  double ratio = 1;         ///< of its amplitude or level to the sound one
};

class ReferenceDistance {
 public:
  static constexpr std::size_t kLeastWindows = 12;

  /// `present`: of the signals of the layout, those that the record to be compared has. Data error
  /// when too few sound windows are left to learn from.
  static Expected<ReferenceDistance> learn(const Reference& reference,
                                           const std::vector<bool>& present);
  ReferenceDistance(ReferenceDistance&&) noexcept;
  ReferenceDistance& operator=(ReferenceDistance&&) noexcept;
  ~ReferenceDistance();

  /// Nothing when there is no sound window of its block and speed, or a value is missing.
  [[nodiscard]] std::optional<Compared> compare(const ReferenceWindow& window) const;
  [[nodiscard]] double threshold() const;
  /// Distances of the sound windows, their record (or part of it) held out.
  [[nodiscard]] const std::vector<double>& held_out() const;
  /// Share of sound windows beyond the threshold: what the tail says, and what so many windows of
  /// which none was beyond it bear out, 1 / (n + 1).
  [[nodiscard]] double extrapolated_rate() const;
  [[nodiscard]] double supported_rate() const;
  /// The factor by which the middle one of the amplitudes has to grow to reach the threshold alone.
  [[nodiscard]] double seen_ratio() const;

 private:
  struct Content;
  explicit ReferenceDistance(std::unique_ptr<Content> content);
  std::unique_ptr<Content> content_;
};

/// The middle of three distances of a cut in a row.
class ThreeInARow {
 public:
  /// Those that waited for a third and never got it stay without a verdict.
  void interrupt() {
    count_ = 0;
    told_ = false;
  }
  /// What is known with this one: nothing for the first two of a cut, then all three, then one
  /// each.
  [[nodiscard]] std::vector<double> add(double distance);

 private:
  double last_[3] = {};
  std::size_t count_ = 0;
  bool told_ = false;
};

/// Data error, naming file and line, for what does not belong there.
Expected<Reference> read_reference(LineReader& lines);
Expected<Reference> read_reference(const std::string& path);
[[nodiscard]] std::string reference_text(const Reference& reference,
                                         const std::vector<std::string>& comments = {});

}  // namespace servosense
