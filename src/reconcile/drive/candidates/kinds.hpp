// The candidates of candidates/candidates.hpp, by kind of effect.
#pragma once

#include "reconcile/drive/candidates/candidates.hpp"

namespace servosense::reconcile {

/// An effect driven by its own class, searched as its traits say (candidates/plain.cpp).
Candidate effect_candidate(std::size_t effect, const DriveSituation& s);

/// Effects with a hidden load or bristle (candidates/memory.cpp).
Candidate coupling_candidate(std::size_t effect, const DriveSituation& s);
Candidate presliding_candidate(std::size_t effect, const DriveSituation& s);
Candidate backlash_candidate(std::size_t effect, const DriveSituation& s);
/// Backlashes over the ranges of its search.
std::vector<std::vector<double>> starts_of_backlash(const std::vector<SearchRange>& ranges);

/// Friction along the stroke, and lines: of the turn, and of time (candidates/lines.cpp).
Candidate profile_candidate(std::size_t effect, const DriveSituation& s);
Candidate ripple_candidate(std::size_t effect, const DriveSituation& s);
Candidate line_candidate(const DriveSituation& s);

/// A force that follows the motion or the effort of another axis (candidates/plain.cpp).
Candidate cross_talk_candidate(const DriveData::Other& other, const DriveSituation& s);

/// The torque constant over the motor's temperature (candidates/motor_temperature.cpp).
Candidate motor_temperature_candidate(const DriveSituation& s);

/// What is ranked and never named (candidates/rivals.cpp).
std::vector<Candidate> drive_rivals(const DriveSituation& s);

}  // namespace servosense::reconcile
