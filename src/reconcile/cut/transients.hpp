// What a cut shows after an entry or a change of feed, and a steady one does not: a mode of the
// tool under even teeth. The deflection that goes with the new force is left behind in the surface,
// and the chips of the next teeth differ until all of them cut alike again.
//
// Simulated over time: rigid forces over the angle, modes stepped exactly for a force that stays
// between two steps, and chips that follow the difference of the displacement to that one tooth ago
// (Altintas 2012, eq. 3.3 and 3.4), summed over the teeth in the cut. Measured and simulated forces
// are compared less their means at each angle of a pass, so that nothing counts that turns with the
// tool. Bad at: chatter, and vibration so strong that teeth leave the cut (chips are linear here).
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "reconcile/cut/average.hpp"
#include "reconcile/cut/force_model.hpp"
#include "servosense/model/structural_mode.hpp"
#include "servosense/reconcile/cutting.hpp"

namespace servosense::reconcile {

class CutTransients {
 public:
  /// What the record does not tell.
  struct Start {
    bool from_rest = false;  ///< the record begins with the cut; else in the middle of one
    bool gradual = false;    ///< a new feed is there after one tooth; else at once
    bool fine = false;       ///< smaller steps, to fit rather than to look
  };
  /// A mode of the tool in one direction, 0 x, 1 y; or of the sensor there (its mass is not used).
  struct Mode {
    std::size_t axis = 0;
    StructuralMode mode;
    bool of_sensor = false;
    bool driven = false;  ///< of the tool, led by the measured force
  };
  /// Sums of squares without a mode and with it, of the samples fitted and of those kept for the
  /// proof.
  struct Judged {
    Mode mode;
    Start start;
    std::array<double, 2> fitted{}, held{};
    /// Of simulated in measured where it was not fitted, 1 when it goes on as it was, and its
    /// standard error for noise of 1 N.
    double held_part = 0, held_part_error = 0;
    /// The same of each pass, held out or not; error 0: nothing to compare.
    std::vector<std::array<double, 2>> part_of_pass{};
    std::array<double, 3> errors{};  ///< of logarithms of frequency, damping and mass, for 1 N
  };

  CutTransients(const CuttingData& data, const CutAverage& average, const CutState& state,
                const Criteria& criteria);

  /// False without a change of feed, or with uneven time steps.
  [[nodiscard]] bool usable() const { return passes_.size() > 1; }
  /// Values compared less the means taken off.
  [[nodiscard]] double freedom(bool held) const { return freedom_[held ? 1 : 0]; }
  /// Of the shortest pass at one feed.
  [[nodiscard]] double shortest_s() const { return shortest_s_; }
  /// The mode that leaves least, refined where a scan takes off more than `worth_N2`. `threads`: as
  /// in Options.
  [[nodiscard]] Judged best_mode(double worth_N2, unsigned threads) const;
  /// The same of the sensor in one direction.
  [[nodiscard]] Judged best_sensor(std::size_t axis, double worth_N2, unsigned threads) const;

  /// The mode that leaves least when the measured force leads the tool: so a cut can be followed
  /// that is not stable. Refined where a scan takes off more than `worth_N2`.
  [[nodiscard]] Judged best_driven(double worth_N2, unsigned threads) const;
  /// Share that the forces of the steady cut explain of what a mode is to explain of the samples
  /// fitted, if they rise and fall once in so many turns.
  [[nodiscard]] double share_of_modulation(double turns) const;
  /// By how many powers of e a vibration of the tool fades within the shortest pass, at the feed
  /// where it lasts longest; below 0 it grows.
  [[nodiscard]] double fading(const Mode& mode) const;
  /// Shares in the forces of where the tool is and of where it was a tooth ago, with standard
  /// errors; both are 1 in a cut that remembers, the second is 0 in one that does not.
  struct Memory {
    double now = 0, before = 0, now_error = 0, before_error = 0;
  };
  struct JudgedMemory {
    Memory all;  ///< of the samples fitted
    std::vector<Memory> of_pass;
    /// Sums of squares of nothing, of where the tool is alone, and of both.
    std::array<double, 3> fitted{}, held{};
  };
  /// What known modes add to the forces, less its means.
  [[nodiscard]] Eigen::VectorXd simulated(const Structure& structure, Start start,
                                          bool remembers) const;
  [[nodiscard]] Judged judged_beside(const Eigen::VectorXd& without,
                                     const Eigen::VectorXd& with) const;
  [[nodiscard]] JudgedMemory memory_of(const Structure& structure) const;

 private:
  struct Pass {
    std::size_t first = 0, last = 0;  ///< samples
    std::size_t level = 0;
  };
  /// Forces on the tool over the grid, rigid and for a displacement along x or y.
  struct Level {
    Eigen::VectorXd rigid_N[2];
    struct Memory {
      double back = 0;
      std::vector<std::array<double, 4>> N_per_m;  ///< xx, yx, xy, yy: force along, displacement
    };
    std::vector<Memory> memories;
    double speed_rad_s = 0;
    /// Share of this level in the force, so far into it: a change that is gradual takes a tooth.
    [[nodiscard]] double share_after(double turned_rad, Start start) const;
  };
  class Tool;
  std::vector<char> find_passes(const CuttingData& data, const CutAverage& average,
                                const Criteria& criteria);
  std::vector<Eigen::VectorXd> add_levels(const CutAverage& average, const CutState& state);
  void score(const CuttingData& data, const CutAverage& average, const CutState& state,
             const std::vector<char>& at_level, const std::vector<Eigen::VectorXd>& seen);
  [[nodiscard]] double longest_memory_s() const;
  struct Trial {
    Mode mode;
    Start start;
    double gain = 0;
  };
  [[nodiscard]] Judged best_of(std::vector<Trial> trials, double worth_N2, unsigned threads) const;
  /// Gain of a mode whose size is what the measurement asks for, and that size.
  void size(Trial& trial, const Eigen::VectorXd& target) const;
  [[nodiscard]] Judged refined(const Mode& mode, Start start) const;
  [[nodiscard]] Eigen::VectorXd simulated(const Mode& mode, Start start) const;
  /// What moves the tool: the forces of the model, or those measured.
  struct Excitation {
    bool measured = false, remembers = true;
    Start start;
  };
  /// Forces that follow from where the tool is, and from where it was a tooth ago. Less their
  /// means.
  struct Vibration {
    Eigen::VectorXd now, before;
  };
  [[nodiscard]] Vibration vibration(const std::vector<Mode>& modes, Excitation by) const;
  [[nodiscard]] int steps_a_sample(const std::vector<Mode>& modes, Excitation by) const;
  [[nodiscard]] Eigen::VectorXd ringing(const Mode& sensor, Start start) const;
  [[nodiscard]] Judged judged(const Mode& mode, Start start, const Eigen::VectorXd& shown,
                              const Eigen::VectorXd& measured) const;
  [[nodiscard]] Eigen::VectorXd compared(const Eigen::VectorXd& xy) const;
  [[nodiscard]] Judged judged(const Mode& mode, Start start) const;
  void take_off_means(Eigen::VectorXd& xy) const;

  std::vector<double> angle_rad_;
  std::array<std::vector<double>, 2> force_N_;  ///< measured, on the tool: x, y
  double step_s_ = 0, shortest_s_ = 1e300;
  double lowest_hz_ = 0, highest_hz_ = 0;
  double cutting_stiffness_N_per_m_ = 0;
  std::vector<Pass> passes_;  ///< one after the other, without gaps
  std::vector<Level> levels_;
  std::vector<std::size_t> mean_of_;  ///< of a sample: its angle within its pass
  std::size_t means_ = 0;
  std::vector<char> scored_;  ///< 0 no, 1 fitted, 2 held out
  Eigen::VectorXd measured_;  ///< less steady forces and means: x of all samples, then y
  Eigen::VectorXd steady_;    ///< the forces of the model, alike
  std::array<double, 2> freedom_{};
};

}  // namespace servosense::reconcile
