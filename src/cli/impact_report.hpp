// The page of 'identify impact'.
#pragma once

#include <span>
#include <string>

#include "servosense/identify/impact.hpp"

namespace servosense::cli {

/// What a shop wants to hear first.
std::string impact_sentence(const ImpactResult& f);

Expected<Done> write_impact_page(const std::string& path, const std::string& response_column,
                                 std::span<const ImpactRecord> records, const ImpactResult& f);

}  // namespace servosense::cli
