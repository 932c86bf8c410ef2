// Where in its reference a program is.
//
// Purpose: counts the program's progress, and finds it again where the controller names its block
// or the spindle comes to a steady speed. A new block: the next section that begins it, round the
// whole program, one section a sample; a block that is nowhere leaves the program lost until a
// known one. A steady speed: the nearest section within reach that has the same block and speed;
// behind a gap of the record, only where there is one in the reference too or the speed is another.
// Delay: for a new block, a sample for each section in between.
// Cost, range: monitors/torque_band.hpp. Numerical bound: half a rounding a step within a point.
// Bad at: programs whose sections of the same block and speed lie closer than reach.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "servosense/core/real_time.hpp"
#include "servosense/monitors/torque_band_points.hpp"

namespace servosense {

template <RealNumber Real>
class ProgramPlace {
 public:
  using Section = TorqueBandSection<Real>;

  void configure(double spacing, double reach) noexcept {
    spacing_ = static_cast<Real>(spacing);
    per_spacing_ = static_cast<Real>(1 / spacing);
    reach_ = static_cast<Real>(reach + 0.5 * spacing);
  }
  /// What it views must outlive its use.
  void set_reference(std::span<const Section> sections, std::size_t points) noexcept {
    sections_ = sections;
    points_ = static_cast<std::uint32_t>(points);
  }
  void start(std::uint32_t cell) noexcept {
    cell_ = cell;
    within_ = 0;
    section_ = 0;
    block_ = kNoBlock;
    seeking_ = lost_ = false;
  }
  void move(Real by) noexcept {
    within_ += by;
    if (within_ >= spacing_) {
      const auto cells = static_cast<std::uint32_t>(within_ * per_spacing_);
      cell_ += cells;
      within_ -= static_cast<Real>(cells) * spacing_;
      if (within_ < 0) within_ = 0;
    }
    while (section_ + 1 < sections_.size() && sections_[section_ + 1].first <= cell_) ++section_;
    // Over for every shift: nothing is expected any more.
    if (static_cast<Real>(cell_) > static_cast<Real>(points_) + reach_ * per_spacing_) lost_ = true;
  }

  /// What the controller reports. True when that has told where the program is; `under_way` has
  /// been counted already of what move() will be given next.
  [[nodiscard]] bool hear(std::int32_t block, Real under_way) noexcept {
    if (block != block_ && block != kNoBlock) begin_seek(block);
    return seeking_ && seek(under_way);
  }
  /// A steady speed begins, or is found behind a gap; 0 = unknown. True when a section does so
  /// here.
  [[gnu::noinline]] bool find(Real speed_rad_s, bool behind_gap) noexcept {
    if (sections_.empty()) return false;
    const bool any_section = !behind_gap || !same_speed(speed_rad_s, sections_[section_]);
    const Real here = static_cast<Real>(cell_) * spacing_ + within_;
    Real nearest = reach_;
    bool any = false;
    std::uint32_t found = 0;
    const std::uint32_t from = section_ > kAround ? section_ - kAround : 0;
    for (std::uint32_t i = from; i < sections_.size() && i <= section_ + kAround; ++i) {
      const Section& s = sections_[i];
      if (s.block != kNoBlock && block_ != kNoBlock && s.block != block_) continue;
      if (!same_speed(speed_rad_s, s) || !(any_section || s.behind_gap)) continue;
      const Real away = size(static_cast<Real>(s.first) * spacing_ - here);
      if (away > nearest) continue;
      nearest = away;
      found = i;
      any = true;
    }
    if (any) join(found);
    return any;
  }

  /// Until a section is found to begin.
  void lose() noexcept { lost_ = true; }

  [[nodiscard]] std::uint32_t cell() const noexcept { return cell_; }
  /// Beyond the cell; below zero just behind a new block.
  [[nodiscard]] Real within() const noexcept { return within_; }
  [[nodiscard]] bool has_sections() const noexcept { return !sections_.empty(); }
  /// Section that the program is in, if it has any.
  [[nodiscard]] const Section& section() const noexcept { return sections_[section_]; }
  /// The controller has named a block of it.
  [[nodiscard]] bool told() const noexcept { return block_ != kNoBlock; }
  /// Nothing is known: the program is over, or the block is not in the reference.
  [[nodiscard]] bool lost() const noexcept { return lost_ || seeking_; }

 private:
  static constexpr std::uint32_t kAround = 4;  // sections, to either side
  static constexpr Real kSameSpeed = Real(0.05);

  static Real size(Real x) noexcept { return x < 0 ? -x : x; }
  static bool same_speed(Real speed_rad_s, const Section& s) noexcept {
    return !(speed_rad_s > 0 && s.speed_rad_s > 0) ||
           size(speed_rad_s - s.speed_rad_s) <= kSameSpeed * s.speed_rad_s;
  }
  void join(std::uint32_t i) noexcept {
    section_ = i;
    cell_ = sections_[i].first;
    within_ = 0;
    lost_ = false;
  }
  [[gnu::noinline]] void begin_seek(std::int32_t block) noexcept {
    block_ = block;
    seeking_ = !sections_.empty() && sections_[0].block != kNoBlock;
    if (seeking_) lost_ = false;
    seek_at_ = section_;
    seek_left_ = static_cast<std::uint32_t>(sections_.size());
  }
  [[gnu::noinline]] bool seek(Real under_way) noexcept {
    const Section& s = sections_[seek_at_];
    const bool begins = seek_at_ == 0 || sections_[seek_at_ - 1].block != s.block;
    if (s.block == block_ && begins) {
      seeking_ = false;
      join(seek_at_);
      within_ = -under_way;
      return true;
    }
    seek_at_ = seek_at_ + 1 < sections_.size() ? seek_at_ + 1 : 0;
    if (--seek_left_ == 0) {
      seeking_ = false;
      lost_ = true;
    }
    return false;
  }

  std::span<const Section> sections_;
  std::uint32_t points_ = 0;
  std::uint32_t cell_ = 0;
  Real within_ = 0;
  std::uint32_t section_ = 0;
  std::int32_t block_ = kNoBlock;
  bool seeking_ = false;
  bool lost_ = false;
  std::uint32_t seek_at_ = 0;
  std::uint32_t seek_left_ = 0;
  Real spacing_ = 1;
  Real per_spacing_ = 1;
  Real reach_ = 0;
};

}  // namespace servosense
