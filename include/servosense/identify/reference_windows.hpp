// Windows of a record as the comparison with a sound reference sees them: levels, orders of the
// rotation and bands of every drive signal.
//
// Features of a signal in a window, relative to the signal's rms in sound cuts (`scale`):
//   level   mean / scale, signed
//   swing   ln of the rms about the mean
//   order   ln of the amplitude at a multiple of the rotation: once a turn, tooth passing and its
//           multiples; the root of the sum of squares of those between them
//   band    ln of the rms in an octave, counted down from half the sample rate, what turns with the
//           spindle taken out
// Logarithms make what grows in proportion a shift; kFaintest keeps what is no part of the signal
// from counting. Orders are projections on the angle with a Hann weight, so that a speed that
// differs or swings does not smear them; octaves overlap as triangles over ln f, so that a line
// that moves a little does not jump from one to the next. Where the speed is but stated, orders
// that an error of kStatedError would smear are left out, and nothing is taken out of the bands.
// Bad at: what shows within one window alone and is smaller than its spread; orders in a window of
// less than kLeastTurns turns.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "servosense/core/channel.hpp"
#include "servosense/io/trace.hpp"

namespace servosense {

struct ReferenceSignal {
  Signal signal;
  double scale = 1;  ///< rms in sound cuts, in its unit
};

/// How windows are cut and what is looked at in them.
struct ReferenceLayout {
  double sample_rate_hz = 0;
  double window_s = 0;
  double speed_rad_s = 0;      ///< usual speed of the spindle in the cuts; 0 = not known: no orders
  bool speed_measured = true;  ///< by a column; else it is the one that the machine file states
  unsigned teeth = 0;          ///< 0 = not known
  std::vector<ReferenceSignal> signals;
  std::size_t effort = 0;     ///< of `signals`: the one that tells a cut from air
  double cutting_level = 0;   ///< mean magnitude of the effort from which on it cuts, in its unit
  std::vector<Signal> place;  ///< positions by which windows are compared with their like
  bool blocks = false;        ///< likewise machine.nc_block
};

enum class ReferenceFeatureKind : std::uint8_t { level, swing, order, between, band };

struct ReferenceFeature {
  std::size_t signal = 0;  ///< of the layout
  ReferenceFeatureKind kind = ReferenceFeatureKind::level;
  double at = 0;  ///< the order, or the middle of the band [Hz]
};

/// All that a window is described by, in their order.
[[nodiscard]] std::vector<ReferenceFeature> reference_features(const ReferenceLayout& layout);
/// "spindle.current_A level", "x.torque_Nm order 4", "x.torque_Nm band 187.5 Hz".
[[nodiscard]] std::string name_of(const ReferenceLayout& layout, const ReferenceFeature& feature);

/// Why a window is not compared.
enum class NotCompared : std::uint8_t {
  no,  ///< it is
  too_few_samples,
  not_cutting,
  entry_or_exit,  ///< cutting, beside a window that is not
  other_speed,    ///< of the spindle than any sound cut, or one that changes within the window
  other_block,    ///< of a block that no sound cut has shown
};

struct ReferenceWindow {
  double from_s = 0, to_s = 0;
  NotCompared why = NotCompared::no;
  double load = 0;             ///< mean magnitude of the effort
  double speed_rad_s = 0;      ///< of the spindle; 0 = not known
  std::int32_t block = -1;     ///< -1 = none
  std::vector<double> place;   ///< one a position of the layout; NaN where it is missing
  std::vector<double> values;  ///< one a feature; NaN where its signal is missing
};

/// The column that tells how far the spindle has turned.
struct TurnColumn {
  std::optional<std::size_t> column;  ///< none: turns at `constant_rad_s`
  bool is_speed = false;              ///< else an angle, which may begin anew with every turn
  bool is_counts = false;
  double rad_per_unit = 1;
  double constant_rad_s = 0;
};

/// How far the spindle turns from row to row.
class TurnCounter {
 public:
  explicit TurnCounter(TurnColumn turn) : turn_(turn) {}
  /// [rad]. `held`: the last good value of each column.
  [[nodiscard]] double add(const TraceRow& row, std::span<const double> held, double passed_s);

 private:
  TurnColumn turn_;
  std::optional<double> last_;
  std::int64_t last_counts_ = 0;
};

/// Cuts the rows of one record into windows, from the first row to the last.
class ReferenceCutter {
 public:
  /// `columns`: the signals of the rows. A signal of the layout that is not among them is NaN in
  /// all windows.
  ReferenceCutter(ReferenceLayout layout, const std::vector<Signal>& columns, TurnColumn turn);

  /// Windows that are known with this row; mostly none. One comes when the next has ended, which
  /// tells an exit. A hole in time is one window of its own.
  std::vector<ReferenceWindow> add(const TraceRow& row);
  /// The windows that the record ends in.
  std::vector<ReferenceWindow> finish();

 private:
  void cut(double to_s, bool hole, std::vector<ReferenceWindow>& done);
  void describe(ReferenceWindow& window) const;
  void hold(const TraceRow& row);

  ReferenceLayout layout_;
  std::vector<ReferenceFeature> features_;
  std::vector<std::optional<std::size_t>> column_, place_;
  std::optional<std::size_t> block_column_;
  TurnCounter turns_;
  std::vector<double> held_;   // of every column of the rows
  std::vector<bool> bad_now_;  // and whether it is no good
  std::vector<std::vector<double>> samples_, places_;
  std::vector<std::size_t> bad_;  // samples of each signal that are no good
  std::vector<double> angle_;     // of the rows of this window
  std::vector<std::int32_t> block_;
  std::optional<ReferenceWindow> waiting_;  // for what comes behind it
  bool air_before_ = false;
  double angle_now_ = 0;
  bool started_ = false;
  double first_s_ = 0, last_s_ = 0, from_s_ = 0;
  std::int64_t index_ = 0;
};

}  // namespace servosense
