// The limits of the NC program reader, in one place, with their kind and source.
#pragma once

#include <cstddef>
#include <cstdint>

namespace servosense::process {

// ---- of the language, as LinuxCNC 2.9 has them (measured on its `rs274`)
// -------------------------

/// Characters of a line that are read; a longer one is refused.
inline constexpr std::size_t kLongestProgramLine = 255;
/// Numbered parameters are #1 to this one.
inline constexpr long kLastParameter = 5601;
/// Of these the machine keeps the value: tool in the spindle, and where it stands.
inline constexpr long kFirstReadOnlyParameter = 5400, kLastReadOnlyParameter = 5428;
/// A subroutine calls the next one so often, and no further.
inline constexpr std::size_t kDeepestCall = 9;
/// #1 to #30 belong to a subroutine.
inline constexpr std::size_t kCallArguments = 30;
/// M words of a block.
inline constexpr int kMostMCodes = 4;
/// Two numbers of a program are equal within this, and a whole number is off by no more.
inline constexpr double kEqualNumbers = 1e-4;
/// Both radii of an arc agree within this [mm], under G20 and under G21, or this share of the
/// larger one, and in no case are they further apart than a hundred times the first.
inline constexpr double kArcCentreInch_mm = 0.0718420489, kArcCentreMetric_mm = 0.0282842712;
inline constexpr double kArcRadiusShare = 0.001, kArcRadiusWorst = 100;
/// No arc has a smaller radius, and an R may be too small for its chord by so much [mm].
inline constexpr double kArcRadius_mm = 0.00127;
/// A semicircle may be this share longer than its radius allows.
inline constexpr double kSemicircleShare = 1e-12;
/// G73 and G83 stop short of the last depth by this [mm].
inline constexpr double kPeckClearance_mm = 0.254;
/// Feed of a move of no length under G93 [program units/min].
inline constexpr double kLeastInverseFeed = 0.1;
/// An angle whose cosine is below this counts as a right one.
inline constexpr double kEqualAngles = 1e-6;
/// Cutter compensation takes corners flatter than this for straight [rad].
inline constexpr double kFlatCorner_rad = 0.05;

/// Cut short at a corner, an arc may miss its radius by this [program units] and may become longer
/// by no more than these, under G21 and under G20 [rad].
inline constexpr double kArcMismatch = 0.01;
inline constexpr double kArcGrowthMetric_rad = 0.0254, kArcGrowthInch_rad = 0.001;

// ---- of this reader, so that a program that never ends is an error (chosen)
// ----------------------

/// Lines that are looked at: 100 times the largest program of a mould shop (some 10^6 blocks).
inline constexpr std::uint64_t kMostLinesRun = 100'000'000;
/// Moves that come of them.
inline constexpr std::uint64_t kMostMoves = 100'000'000;
/// No point is farther from zero [m, deg]: beyond it numbers lose their micrometres.
inline constexpr double kFarthest = 1e6;
/// Bytes of a program file.
inline constexpr std::size_t kLargestProgram = std::size_t{1} << 30U;

}  // namespace servosense::process
