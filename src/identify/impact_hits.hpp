// Hits of several records, each judged: is it used, and if not, why.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "impact_contacts.hpp"
#include "impact_response.hpp"
#include "servosense/identify/impact.hpp"

namespace servosense::impact {

struct JudgedHit {
  ImpactHit hit;
  ForcePulse pulse;
  std::size_t rest_from = 0;  ///< first sample of the rest before it
  std::size_t end = 0;        ///< behind the last sample that is its own
  Response response;          ///< of those that the force does not rule out
};

struct JudgedHits {
  std::vector<ForceRecord> force;  ///< a record each
  std::vector<JudgedHit> hits;
  double response_noise = 0;  ///< standard deviation of a sample
  bool rested = false;        ///< it is known from before the hits; else from their tails
  std::size_t length = 0;     ///< samples of a segment
};

/// All hits that are found. `length_s` as in ImpactOptions. When none is used, `length` is 0.
[[nodiscard]] JudgedHits judge_hits(std::span<const ImpactRecord> records, double length_s);

}  // namespace servosense::impact
