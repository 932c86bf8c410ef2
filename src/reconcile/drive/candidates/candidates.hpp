// The catalogue of drive effects as candidates for what is missing.
#pragma once

#include <initializer_list>
#include <memory>
#include <vector>

#include "reconcile/drive/limit_cycle.hpp"
#include "reconcile/drive/signals.hpp"
#include "servosense/reconcile/drive.hpp"
#include "servosense/reconcile/problem.hpp"

namespace servosense::reconcile {

/// What the record is like, as far as candidates depend on it.
struct DriveSituation {
  const DriveData* data = nullptr;
  std::shared_ptr<const DriveSignals> signals;
  const Criteria* criteria = &kCriteria;
  DriveModelConfig model;   ///< recalibrated
  DriveModelConfig acting;  ///< the same, with friction and loads that were found in a first pass
  double top_speed = 0;
  double top_current_A = 0;  ///< 0: the effort is no current
  double duration_s = 0;
  double travel = 0;
  double low = 0, high = 0;     ///< positions of the rows fitted
  bool constant_known = false;  ///< the model has a constant load
  bool timing_open = false;     ///< the effort is later than a sound record explains, or
  bool read_late = false;       ///< it is read so late that it is behind the motion
  double known_lag_s = 0;       ///< of the lateness, what the file tells of the loop
  std::vector<double>
      backlash;  ///< that was found together with the presliding distance; empty: none was
  double presliding_alone = 0;         ///< of friction, as fitted before that backlash
  double lowest_C = 0, highest_C = 0;  ///< of the motor, in the rows fitted
  Column per_kelvin;       ///< what 1/K of the torque constant adds to the effort, in rows
  LimitCycle limit_cycle;  ///< that the drive keeps up
};

/// One candidate for each effect that the model lacks.
std::vector<Candidate> drive_candidates(const DriveSituation& situation);

/// A drive effect with the first of its parameters, a value each.
EffectSetting effect_with(std::size_t effect, std::initializer_list<double> values);

/// Adds an effect to those of a drive, as long as there is room.
void add_effect(DriveEffectsConfig& effects, const EffectSetting& setting);

/// The setting of a drive effect that a meaning stands for.
EffectSetting setting_of(const std::string& name, const Meaning& meaning, bool turns);

}  // namespace servosense::reconcile
