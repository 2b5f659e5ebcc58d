#pragma once

#include <optional>
#include <string>
#include <vector>

namespace acmp {

/// Least number of single-letter insertions, deletions and replacements between two words.
size_t EditDistance(const std::string& a, const std::string& b);

/// The first of the words with the least distance to `word`; nothing where even that is more than half of its letters.
std::optional<std::string> MostSimilar(const std::string& word, const std::vector<std::string>& words);

}  // namespace acmp
