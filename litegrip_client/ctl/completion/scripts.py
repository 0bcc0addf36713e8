"""The scripts that bash, zsh and fish load: each asks `litegripctl __complete` for words.

They must not know commands or options.
"""

from __future__ import annotations

_BASH = r"""# Completion of litegripctl in bash. For now:  eval "$(litegripctl completion bash)"
# For good: write this to ~/.local/share/bash-completion/completions/litegripctl
_litegripctl() {
    local line=${COMP_LINE:0:COMP_POINT} current tail cut files word
    local -a words
    # Without -r, for what stands behind a backslash is meant as it is.
    read -a words <<<"$line"
    [[ $line == *[!\\][[:space:]] ]] && words+=("")
    current=${words[${#words[@]} - 1]}
    IFS= read tail <<<"$2"
    cut=${current%"$tail"} # bash cuts words at "=", ":" and "@", and takes what comes behind
    COMPREPLY=()
    {
        read -r files
        while IFS=$'\t' read -r word _; do
            word=${word#"$cut"}
            [[ $word ]] || continue
            # Unquoted, a name could run as a command. Where paths may stand, bash quotes by itself,
            # but for "$" and "`", whose names are left out.
            if [[ $files == files ]]; then
                [[ $word == *[\$\`]* ]] || COMPREPLY+=("$word")
            else
                printf -v word %q "$word"
                COMPREPLY+=("$word")
            fi
        done
    } < <("${1/#\~/$HOME}" __complete "${words[@]:1}" 2>/dev/null)
    if [[ $files == files ]]; then
        compopt -o filenames 2>/dev/null
        while IFS= read -r word; do
            COMPREPLY+=("$word")
        done < <(compgen -f -- "$2")
    fi
    [[ ${COMPREPLY[0]} == *= ]] && compopt -o nospace 2>/dev/null
    return 0
}
complete -F _litegripctl litegripctl
"""

_ZSH = r"""#compdef litegripctl
# Completion of litegripctl in zsh. For now, after compinit:  eval "$(litegripctl completion zsh)"
# For good: write this to a file _litegripctl in a directory of $fpath.
_litegripctl() {
    local files word text
    local -a found unfinished
    {
        read -r files
        while IFS=$'\t' read -r word text; do
            word="${${word//\\/\\\\}//:/\\:}${text:+:$text}"
            if [[ ${word%%:*} == *= ]]; then unfinished+=("$word"); else found+=("$word"); fi
        done
    } < <("${words[1]/#\~/$HOME}" __complete "${(@Q)words[2,CURRENT]}" 2>/dev/null)
    _describe litegripctl found -- unfinished -S ''
    [[ $files == files ]] && _files
}
if [[ ${funcstack[1]} == _litegripctl ]]; then
    _litegripctl "$@"
else
    compdef _litegripctl litegripctl
fi
"""

_FISH = r"""# Completion of litegripctl in fish. For now:  litegripctl completion fish | source
# For good: write this to ~/.config/fish/completions/litegripctl.fish
function __litegripctl_words
    set -l before (commandline -opc)
    set -l current (string unescape -- (commandline -ct))
    set -l found ($before[1] __complete $before[2..-1] "$current" 2>/dev/null)
    if test "$found[1]" = files
        __fish_complete_path "$current"
    end
    printf '%s\n' $found[2..-1]
end
complete -c litegripctl -f -a '(__litegripctl_words)'
"""

SCRIPTS = {"bash": _BASH, "zsh": _ZSH, "fish": _FISH}
