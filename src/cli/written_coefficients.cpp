#include "written_coefficients.hpp"

#include "estimate_text.hpp"
#include "servosense/io/coefficient_file.hpp"

namespace servosense::cli {

void write_coefficients(MachineFile& file, std::span<const NamedCoefficient> coefficients,
                        const std::string& provenance, std::vector<std::string>& remarks) {
  for (const char* key : kCoefficientKeys) file.remove("tool", key);
  for (const NamedCoefficient& c : coefficients) {
    if (c.estimate.value < 0 && !std::string_view(c.key).starts_with("axial")) {
      remarks.push_back(std::string(c.key) + " is below zero and not written");
      continue;
    }
    file.set("tool", c.key, rounded(c.estimate.value), plus_minus(c.estimate));
  }
  const Estimate& tangential = coefficients.front().estimate;
  file.set("tool", "tangential_coefficient_relative_error",
           rounded(tangential.standard_error / tangential.value));
  file.set("tool", "provenance", provenance);
}

Expected<Done> write_coefficient_file(const std::string& path, const MachineFile& machine,
                                      std::span<const NamedCoefficient> coefficients,
                                      const std::string& provenance,
                                      std::vector<std::string>& remarks) {
  auto file = MachineFile::parse("# cutting coefficients of a tool and material\n[tool]\n", path);
  if (!file) return file.error();
  if (const auto material = machine.text("tool", "material"))
    file->set("tool", "material", *material);
  write_coefficients(*file, coefficients, provenance, remarks);
  return file->write(path);
}

}  // namespace servosense::cli
