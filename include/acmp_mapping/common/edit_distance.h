#pragma once

#include <string>
#include <vector>

namespace acmp {

/// Least number of single-letter insertions, deletions and replacements between two words.
size_t EditDistance(const std::string& a, const std::string& b);

/// The first of the words (not empty) with the least distance to `word`.
std::string MostSimilar(const std::string& word, const std::vector<std::string>& words);

}  // namespace acmp
